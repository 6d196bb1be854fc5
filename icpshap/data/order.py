"""The order of scans by their names: one that is certain, or an error."""

import re
from itertools import pairwise
from pathlib import Path
from string import ascii_lowercase

from icpshap.data.formats import stem_of
from icpshap.errors import DataError

# Words for the scan that stays and for the one that moves onto it.
ROLES = (
    *(("reference", "source"), ("target", "source"), ("reference", "reading")),
    *(("fixed", "moving"), ("first", "second"), ("before", "after")),
)


def in_order(folder: Path, paths: list[Path]) -> list[Path]:
    """The files below a folder by the numbers in their names, among which no two may be equal.

    Names without numbers are in order if all that they differ in is a letter, from a on, or if they
    are two, of which one is the reference and the other the source (ROLES). Raises DataError for
    any other.
    """
    names = {path: path.relative_to(folder).as_posix() for path in paths}
    paths = sorted(paths, key=lambda path: _natural_order(names[path]))
    for one, other in pairwise(paths):
        if _natural_order(names[one]) == _natural_order(names[other]):
            raise DataError(
                f"{folder}: {names[one]} and {names[other]} have the same numbers, expected names"
                " that say which comes first.",
                "rename one of them, or take it away if it is a copy.",
            )
    stems = [stem_of(names[path]) for path in paths]
    if not any(map(_numbers, stems)):
        return [paths[place] for place in _order_without_numbers(folder, stems, names, paths)]
    for (stem, path), (next_stem, next_path) in pairwise(zip(stems, paths, strict=True)):
        if not _is_certain(stem, next_stem):
            raise _uncertain(folder, names[path], names[next_path], names, paths)
    return paths


def _is_certain(one, other):
    """Whether the numbers in two names say that the first comes first."""
    if not (_numbers(one) and _numbers(other) and _numbers(one) < _numbers(other)):
        return False
    decimals = [re.findall(r"\d+\.\d+", name) for name in (one, other)]
    if [len(found) for found in decimals] != [1, 1]:
        return True
    # 1.5 follows 1.25, though 25 follows 5.
    return float(decimals[0][0]) < float(decimals[1][0])


def _order_without_numbers(folder, stems, names, paths):
    """Places of the names in their order."""
    letters = "".join(stem[-1] for stem in stems).lower()
    if len({stem[:-1] for stem in stems}) == 1 and ascii_lowercase.startswith(letters):
        return range(len(stems))
    words = [set(re.split(r"[^a-z]+", stem.lower())) for stem in stems]
    if len(words) == 2:
        for first, second in ROLES:
            for order in ([0, 1], [1, 0]):
                one, other = (words[place] for place in order)
                if first in one - other and second in other - one:
                    return order
    raise _uncertain(folder, names[paths[0]], names[paths[1]], names, paths)


def _uncertain(folder, one, other, names, paths):
    listed = ", ".join(names[path] for path in paths[:3]) + ", ..." * (len(paths) > 3)
    return DataError(
        f"{folder}: it is not certain whether {one} or {other} comes first; expected numbers in the"
        " names of all scans that say so.",
        f"number them, as in scan_0, scan_1; or list them in order: `files: [{listed}]` of the"
        " folder.",
    )


def _numbers(name):
    return [int(number) for number in re.findall(r"\d+", name)]


def _natural_order(name):
    """Sort key by which scan_2 comes before scan_10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]
