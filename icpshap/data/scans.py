"""Scans on disk: read and checked strictly.

A *scan* is an (n, 3) float64 array [m] in the scanner frame. Nothing is corrected silently:
whatever does not fit is a `DataError`. Each format is a module of ``formats/``.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from icpshap.data.files import readable
from icpshap.data.formats import COLUMN_READERS, READERS, TIMED_READERS, suffix_of
from icpshap.data.formats._lines import AXES
from icpshap.errors import DataError

MINIMUM_POINTS = 1000
MAXIMUM_COORDINATE = 1e5  # m; no scanner sees so far, and few maps begin so near their origin
SCAN_SUFFIXES = tuple(READERS)


def read_scan(
    path: str | Path, drop_non_finite: bool = False, columns: Sequence[str] | None = None
) -> tuple[np.ndarray, int]:
    """Points (n, 3) float64 [m] of a scan file, and how many rows were dropped as not finite.

    The suffix of ``path``, one of SCAN_SUFFIXES in lower or upper case, says the format;
    ``columns`` names all columns of a file that does not. Rows that are not finite are an error
    unless ``drop_non_finite``. Raises DataError.
    """
    return _finite(Path(path), (), drop_non_finite, columns)


def read_timed_scan(
    path: str | Path,
    time: str | None,
    drop_non_finite: bool = False,
    columns: Sequence[str] | None = None,
) -> tuple[np.ndarray, np.ndarray | None, int]:
    """The same with the times (n,) of the points, in the column that the file calls ``time``.

    (points, times, dropped); times are None if ``time`` is. They are in any unit, and the rows in
    any order; all at one time is a DataError.
    """
    if time is None:
        points, dropped = read_scan(path, drop_non_finite, columns)
        return points, None, dropped
    path = Path(path)
    values, dropped = _finite(path, (time,), drop_non_finite, columns)
    points, times = np.ascontiguousarray(values[:, :3]), values[:, 3].copy()
    if len(times) and times.min() == times.max():
        raise DataError(
            f"{path}: all {len(times)} values in the column {time} are {times[0]:g}, expected the"
            " times at which the points were measured, which differ.",
            "set `time` of the sequence to another column, or leave it out: `scan_order` then says"
            " in which order the points were measured.",
        )
    return points, times, dropped


def _finite(path, more, drop_non_finite, columns):
    """Finite rows (n, 3 or 4) of x, y, z and of `more`, and how many were dropped."""
    read = _reader(path, more, columns)
    with readable(path):
        points = read(path)
    if not len(points):
        raise DataError(f"{path}: no points.", "get or export the file again.")
    finite = np.isfinite(points).all(axis=1)
    dropped = int(np.count_nonzero(~finite))
    if dropped and not drop_non_finite:
        raise DataError(
            f"{path}: {dropped} of {len(points)} rows are not finite (NaN or infinite"
            f" {', '.join(['x', 'y or z'] if not more else ['x', 'y', f'z or {more[0]}'])}),"
            f" the first is row {np.argmin(finite) + 1} of the points.",
            "remove them, or set `drop_non_finite: true` (--drop-non-finite) to leave them out and"
            " count them.",
        )
    points = points[finite] if dropped else points
    _require_metres(path, points[:, :3], finite)
    return points, dropped


def _reader(path, more, columns):
    """Function of a `Path` that reads x, y, z and `more` of a file of its format."""
    suffix = suffix_of(path)
    if suffix not in SCAN_SUFFIXES:
        raise DataError(
            f"{path}: no scan format of this name.", f"use one of {', '.join(SCAN_SUFFIXES)}."
        )
    if columns is not None:
        if suffix not in COLUMN_READERS:
            raise DataError(
                f"{path}: {suffix} files name their columns themselves, expected a format that does"
                f" not: {', '.join(COLUMN_READERS)}.",
                "leave out `columns` of the folder.",
            )
        return lambda path: COLUMN_READERS[suffix](path, list(columns), (*AXES, *more))
    readers = TIMED_READERS if more else READERS
    if suffix not in readers:
        raise DataError(
            f"{path}: {suffix} files are read without times, expected a format that has a column"
            f" {more[0]}.",
            f"use one of {', '.join(readers)}, or leave out `time` of the sequence.",
        )
    return lambda path: readers[suffix](path, *more)


def _require_metres(path, points, finite):
    """Raise DataError if a coordinate (n, 3) is too large to be in metres from the scanner.

    ``finite`` (rows,) marks the rows of the file that the points are.
    """
    # Two numbers instead of another array of this size.
    if not len(points) or max(points.max(), -points.min()) <= MAXIMUM_COORDINATE:
        return
    point, axis = np.argwhere(np.abs(points) > MAXIMUM_COORDINATE)[0]
    raise DataError(
        f"{path}: {'xyz'[axis]} is {points[point, axis]:.6g} in row"
        f" {np.flatnonzero(finite)[point] + 1} of the points, expected at most"
        f" {MAXIMUM_COORDINATE:g} m.",
        "a scan is in metres and in the scanner's own frame: check the units, subtract the origin"
        " of a map, and take out what marks beams without a return.",
    )


def check_scan(points: np.ndarray, minimum_range: float, where: str) -> None:
    """Raise DataError unless at least 1,000 points (n, 3) lie beyond ``minimum_range`` [m]."""
    far = int(np.count_nonzero(np.linalg.norm(points, axis=1) > minimum_range))
    if far < MINIMUM_POINTS:
        raise DataError(
            f"{where}: {far} of {len(points)} points are farther than {minimum_range} m from the"
            f" scanner, at least {MINIMUM_POINTS} are needed.",
            "check that the scan is in metres and in the scanner's own frame; the chain's"
            " minimum range leaves out what is nearer.",
        )
