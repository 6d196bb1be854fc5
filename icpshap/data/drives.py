"""Which poses of a longer drive are those of the scans: by times or numbers in their names."""

import logging
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from icpshap.data.formats import stem_of
from icpshap.errors import DataError

log = logging.getLogger(__name__)

TOLERANCE = 1e-3  # s between a scan and its pose
UNITS = (1, 1e-3, 1e-6, 1e-9)  # s, of whole numbers that are times


def lines_of_scans(
    path: str | Path, poses: int, stamps: np.ndarray | None, names: Sequence[str]
) -> list[int]:
    """Places of the poses of the scans of these names, in a file of more of them.

    poses: how many the file has; stamps: their times (poses,) [s], or None; names: of files, with
    the folders that they lie in. A name fits by the time in it, in seconds or a whole number of
    milli-, micro- or nanoseconds, or by its last number, which counts poses from 0. Raises
    DataError unless just one of both fits all names.
    """
    found = [] if stamps is None else list(_by_time(stamps, names))
    by_number = _by_number(poses, names)
    if by_number is not None:
        found.append(by_number)
    if len({tuple(places) for places in found}) != 1:
        said = "do not say which are theirs"
        if found:
            said = "fit some of them by their times, and others by their numbers"
        raise DataError(
            f"{path}: {poses} poses for {len(names)} scans, whose names ({_few(names)}) {said};"
            f" expected the times of their poses, or numbers from 0 to {poses - 1}.",
            "leave just the poses of the scans in the file, a line for each scan in their order.",
        )
    log.info("%s: %d of %d poses, by the names of the scans", path, len(names), poses)
    return found[0]


def _by_number(poses, names):
    """Places of the poses by the last number in each name; None if these are none."""
    numbers = [_last_number(name) for name in names]
    if not all(number.isdecimal() for number in numbers):
        return None
    places = [int(number) for number in numbers]
    return places if _ascend(places) and places[-1] < poses else None


def _by_time(stamps, names):
    """Places of the poses by the time in each name, for each way to read it by which all fit."""
    texts = [_last_number(name) for name in names]
    if not all(texts):
        return
    for unit in UNITS if not any("." in text for text in texts) else UNITS[:1]:
        times = np.array([float(text) * unit for text in texts])
        nearest = np.abs(stamps[None] - times[:, None]).argmin(axis=1)
        if (np.abs(stamps[nearest] - times) <= TOLERANCE).all() and _ascend(nearest):
            yield nearest.tolist()


def _ascend(places):
    return all(one < other for one, other in pairwise(places))


def _last_number(name):
    """The last number in a name without the suffix of its format, as text; "" if there is none."""
    return (re.findall(r"\d+(?:\.\d+)?", stem_of(name)) or [""])[-1]


def _few(names):
    return ", ".join(names[:2]) + ", ..." * (len(names) > 2)
