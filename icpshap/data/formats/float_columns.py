"""Rows of 4-byte floats without a header, as KITTI and nuScenes have them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from icpshap.data.formats._cloud import as_doubles
from icpshap.data.formats._lines import AXES, GET_AGAIN
from icpshap.data.formats._names import BY_KEY, places_of
from icpshap.errors import DataError

SUFFIXES = (".bin",)
KITTI = (*AXES, "intensity")
NUSCENES = (*KITTI, "ring")
VALUE = np.dtype("<f4")


def read_columns(path: Path, columns: Sequence[str] | None, wanted: Sequence[str]) -> np.ndarray:
    """The `wanted` columns (n, k) of rows of these columns, by default of KITTI's.

    Raises DataError.
    """
    columns = columns or KITTI
    content = path.read_bytes()
    width = len(columns)
    places = places_of(path, width, columns, wanted)
    if len(content) % (width * VALUE.itemsize):
        raise DataError(
            f"{path}: {len(content)} bytes, expected a multiple of {width * VALUE.itemsize}:"
            f" {width} columns ({', '.join(columns)}) of {VALUE.itemsize} bytes.",
            _hint(len(content), width),
        )
    rows = np.frombuffer(content, VALUE).reshape(-1, width)
    # Of rows of another width, the columns would be mixed, and coordinates have both signs.
    if "intensity" in columns and (rows[:, columns.index("intensity")] < 0).any():
        raise DataError(
            f"{path}: read as rows of {width} columns ({', '.join(columns)}), an intensity is"
            " negative, expected none.",
            f"the rows may have another width: {_hint(len(content), width)}",
        )
    return as_doubles(rows[:, places])


def _hint(size, width):
    if width != len(NUSCENES) and size % (len(NUSCENES) * VALUE.itemsize) == 0:
        return (
            f"five columns would fit, as nuScenes has them: set `columns: [{', '.join(NUSCENES)}]`"
            " of the folder."
        )
    return f"name the columns in their order: {BY_KEY}; {GET_AGAIN}"
