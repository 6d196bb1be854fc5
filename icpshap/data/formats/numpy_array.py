"""One array of numpy's: a row for each point, or a field for each column."""

from icpshap.data.formats._lines import AXES
from icpshap.data.formats._numpy import array_of, columns_of

SUFFIXES = (".npy",)


def read(path):
    """Points (n, 3) [m]: the first three columns, or the fields x, y and z. Raises DataError."""
    return read_columns(path, None, AXES)


def read_timed(path, time):
    """The same with the field of the name ``time`` after them, (n, 4)."""
    return read_columns(path, None, (*AXES, time))


def read_columns(path, columns, wanted):
    """The `wanted` columns (n, k) of an array of these columns; fields have names of their own."""
    with path.open("rb") as file:
        content = file.read()
    return columns_of(path, array_of(path, content), columns, wanted)
