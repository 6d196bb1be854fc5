"""Several arrays of numpy's in one file: the points are one of them, or x, y and z are one each."""

import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from icpshap.data.formats._cloud import as_doubles
from icpshap.data.formats._lines import AXES, GET_AGAIN, no_time_column
from icpshap.data.formats._names import named_axes
from icpshap.data.formats._numpy import array_of, columns_of
from icpshap.errors import DataError

SUFFIXES = (".npz",)
POINTS = ("points", "xyz", "point_cloud", "pointcloud", "cloud", "pc", "pts", "positions", "scan")
MEMBER = ".npy"
MAXIMUM_BYTES = 2**31  # of an array
MAXIMUM_EXPANSION = 1032  # of what zip files are compressed by


def read_columns(path: Path, columns: Sequence[str] | None, wanted: Sequence[str]) -> np.ndarray:
    """The `wanted` columns (n, k) of the array that is called like one of POINTS, or the only one.

    Else of the arrays x, y and z. Times are a column or field of the array of points, or an array
    of their own. Raises DataError.
    """
    try:
        with path.open("rb") as file, zipfile.ZipFile(file) as archive:
            members = {
                info.filename.removesuffix(MEMBER): info
                for info in archive.infolist()
                if info.filename.endswith(MEMBER)
            }
            return _columns(path, archive, members, columns, wanted)
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise DataError(
            f"{path}: no archive as numpy writes it ({error or 'it ends early'}).", GET_AGAIN
        ) from None


def _columns(path, archive, members, columns, wanted):
    names = list(members)
    known = [name for name in names if name.lower() in POINTS]
    axes = named_axes(names)
    if len(known) == 1 or len(names) == 1:
        name = (known or names)[0]
        array = _array(path, archive, members[name])
        own: Sequence[str] = wanted
        separate: Sequence[str] = ()
        if array.dtype.names is None and not (columns and set(wanted) <= set(columns)):
            own, separate = wanted[: len(AXES)], wanted[len(AXES) :]
        points = columns_of(f"{path}, array {name}", array, columns, own)
    elif not known and all(len(places) == 1 for places in axes):
        points, separate = None, [*(names[place] for (place,) in axes), *wanted[len(AXES) :]]
    else:
        raise DataError(
            f"{path}: {len(names)} arrays ({', '.join(names) or 'none'}), expected one of points,"
            f" called {', '.join(POINTS[:-1])} or {POINTS[-1]}, or one each of x, y and z.",
            "save the points again: np.savez(path, points=points).",
        )
    rows = [] if points is None else [points]
    for name in separate:
        if name not in members:
            raise no_time_column(path, name, names)
        rows.append(_vector(path, name, _array(path, archive, members[name])))
    if len({len(part) for part in rows}) > 1:
        raise DataError(
            f"{path}: arrays of {', '.join(str(len(part)) for part in rows)} rows, expected as"
            " many of each.",
            GET_AGAIN,
        )
    return np.column_stack(rows)


def _array(path, archive, info):
    """An array of the archive, whose size is compared with that of the file before it is read."""
    if info.file_size > min(MAXIMUM_BYTES, 100 + MAXIMUM_EXPANSION * info.compress_size):
        raise DataError(
            f"{path}, array {info.filename}: {info.file_size} bytes out of {info.compress_size},"
            " expected a scan.",
            GET_AGAIN,
        )
    return array_of(f"{path}, array {info.filename}", archive.read(info))


def _vector(path, name, array):
    array = array.reshape(-1) if array.ndim == 2 and array.shape[1] == 1 else array
    if array.ndim != 1 or array.dtype.kind not in "fiu":
        raise DataError(
            f"{path}, array {name}: shape {array.shape} of {array.dtype}, expected a number for"
            " each point.",
            "save it as an array of one dimension.",
        )
    return as_doubles(array)
