"""Arrays as numpy writes them, read without trusting what their headers announce."""

import math
import tokenize
from io import BytesIO

import numpy as np

from icpshap.data.formats._cloud import as_doubles
from icpshap.data.formats._lines import AXES, GET_AGAIN, shown
from icpshap.data.formats._names import BY_KEY, places_by_name, places_of, require_coordinates
from icpshap.errors import DataError

HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def array_of(where, content):
    """The array that the bytes of a .npy file hold. Raises DataError, also for pickled objects."""
    file = BytesIO(content)
    try:
        version = np.lib.format.read_magic(file)
        if version not in HEADERS:
            raise ValueError(f"version {version[0]}.{version[1]} of the format")
        shape, is_fortran, dtype = HEADERS[version](file)
    except (ValueError, TypeError, SyntaxError, RecursionError, tokenize.TokenError) as error:
        raise DataError(
            f"{where}: no array as numpy writes it ({shown(str(error))[1:-1]}).", GET_AGAIN
        ) from None
    if dtype.hasobject:
        raise DataError(
            f"{where}: an array of Python objects, expected one of numbers.",
            "save it as an array of numbers: np.save(path, np.asarray(points, dtype=float)).",
        )
    left = len(content) - file.tell()
    if math.prod(shape) * dtype.itemsize != left:
        raise DataError(
            f"{where}: {left} bytes of data, expected {math.prod(shape) * dtype.itemsize}: the"
            f" header says an array of shape {shape}.",
            GET_AGAIN,
        )
    values = np.frombuffer(content, dtype, math.prod(shape), file.tell())
    return values.reshape(shape, order="F" if is_fortran else "C")


def columns_of(where, array, columns, wanted):
    """The `wanted` columns (n, k) of an array (n, width), or of one (n,) with named fields.

    columns: names of the columns of the former, or None. Raises DataError.
    """
    if array.dtype.names:
        return _fields(where, array, wanted)
    if array.dtype.kind not in "fiu":
        raise DataError(
            f"{where}: an array of {array.dtype}, expected one of numbers.",
            "save the points as an array of floats.",
        )
    if array.ndim != 2:
        raise DataError(
            f"{where}: an array of shape {array.shape}, expected (points, columns).",
            "reshape it, a row a point, and save it again.",
        )
    rows, width = array.shape
    if rows == len(AXES) < width or width > 1000:
        raise DataError(
            f"{where}: an array of shape {array.shape}, expected a row for each point, with x, y"
            " and z as its first columns.",
            "transpose it, and save it again.",
        )
    points = as_doubles(array[:, places_of(where, width, columns, wanted)])
    if columns is None:
        require_coordinates(where, points, width)
    return points


def _fields(where, array, wanted):
    names = list(array.dtype.names)
    places = places_by_name(where, names, wanted) if array.ndim == 1 else None
    if places is None:
        raise DataError(
            f"{where}: an array of shape {array.shape} with the fields {', '.join(names)};"
            " expected one dimension, and x, y and z, each once.",
            f"rename the fields, or save the points without names; then {BY_KEY} says what they"
            " are.",
        )
    found = [names[place] for place in places]
    if wrong := [name for name in found if array.dtype[name].kind not in "fiu"]:
        raise DataError(
            f"{where}: the field {wrong[0]} is of {array.dtype[wrong[0]]}, expected numbers.",
            "save it as numbers.",
        )
    return np.column_stack([as_doubles(array[name]) for name in found])
