"""Point clouds that begin with a header in words: what .ply and .pcd files have in common.

Open3D reads neither: at a token that is no number, and where a header announces more than there
is, its readers leave points zero or whatever is in memory, or end the process. Here nothing is
allocated for rows that the file is too short to hold.
"""

import os
import re
from array import array
from itertools import islice
from typing import NamedTuple

import numpy as np

from icpshap.data.formats._lines import (
    AXES,
    GET_AGAIN,
    LONGEST,
    no_time_column,
    not_a_number,
    shown,
    too_long,
    wrong_width,
)
from icpshap.data.formats._names import named_axes
from icpshap.errors import DataError

LONGEST_HEADER = 2**20  # bytes
MAXIMUM_COLUMNS = 1000
BLOCK = 2**22  # bytes of rows at a time


class Field(NamedTuple):
    """A column of the rows, or ``width`` adjacent ones of one name."""

    name: str
    kind: str  # as numpy writes it, byte order included: "<f4"
    width: int = 1

    @property
    def bytes(self):
        return np.dtype(self.kind).itemsize * self.width


class Rows(NamedTuple):
    """The points as a header describes them: how many, and the fields of each in their order."""

    points: int
    fields: list

    @property
    def bytes(self):
        """Bytes of one row in binary."""
        return sum(field.bytes for field in self.fields)

    @property
    def columns(self):
        """Names of the columns; one that is there three times is listed three times."""
        return [field.name for field in self.fields for _ in range(field.width)]


class HeaderError(ValueError):
    """What is wrong with a header, in words, and in which line if not the last one read."""

    def __init__(self, problem, line=None):
        super().__init__(problem)
        self.line = line


class HeaderLines:
    """The words of each line up to the one that begins with ``last``, where ``file`` then stands.

    ``file`` is open in binary; ``number`` is that of the last line read, counted from 1. Raises
    HeaderError where that line is missing.
    """

    def __init__(self, file, last):
        self._file, self._last = file, last
        self.number = 0

    def __iter__(self):
        while self._file.tell() < LONGEST_HEADER:
            line = self._file.readline(LONGEST_HEADER)
            self.number += 1
            if not line:
                raise HeaderError(f"the file ends, expected {self._last}")
            # A comment may be in any language.
            words = line.decode("utf-8", errors="replace").split()
            if words:
                yield words
            if words[:1] == [self._last]:
                return
        raise HeaderError(f"no {self._last} within {LONGEST_HEADER} bytes")


def read_header(path, suffix, file, last, parse):
    """What ``parse(lines)`` makes of the `HeaderLines`, and the number of the line after them.

    ``suffix`` names the format in messages. ``parse`` may raise HeaderError. Raises DataError.
    """
    lines = HeaderLines(file, last)
    try:
        return parse(lines), lines.number + 1
    except HeaderError as error:
        raise DataError(
            f"{path}: no readable {suffix} header (of a cloud with plain x, y, z columns): line"
            f" {error.line or lines.number}: {error}.",
            "the file may be empty, cut off or of another format; export it again.",
        ) from None


def whole_number(text, what, line=None):
    """The number that a header gives for ``what``. Raises HeaderError for anything else."""
    if not re.fullmatch("[0-9]{1,15}", text):
        raise HeaderError(f"{what} {shown(text)}, expected a whole number, not negative", line)
    return int(text)


def named_columns(path, rows, names):
    """The names that the rows give to the columns x, y, z and what else is named.

    Raises DataError unless each is one column.
    """
    fields = [field.name for field in rows.fields]
    columns = shown(", ".join(fields) or "none")[1:-1]
    places = dict(zip(AXES, named_axes(fields), strict=True))
    if missing := [axis for axis, found in places.items() if not found]:
        raise DataError(
            f"{path}: no column {', '.join(missing)} in the header; its columns are {columns}.",
            "a scan needs the columns x, y and z; rename them or export with them.",
        )
    counts = {axis: [rows.fields[k].width for k in found] for axis, found in places.items()}
    if repeated := [axis for axis in AXES if counts[axis] != [1]]:
        raise DataError(
            f"{path}: more than one column {', '.join(repeated)} in the header, expected one; its"
            f" columns are {columns}.",
            "rename the others, or export with one of each.",
        )
    for name in names[len(AXES) :]:
        if rows.columns.count(name) != 1:
            raise no_time_column(path, name, rows.columns)
    if (width := sum(field.width for field in rows.fields)) > MAXIMUM_COLUMNS:
        raise DataError(
            f"{path}: {width} columns in the header, at most {MAXIMUM_COLUMNS} are accepted.",
            "the header may be damaged; export the scan with fewer columns.",
        )
    return (*(fields[place] for (place,) in places.values()), *names[len(AXES) :])


def bytes_left(file):
    """How many bytes of an open file are ahead."""
    position = file.tell()
    size = file.seek(0, os.SEEK_END)
    file.seek(position)
    return size - position


# Text


def text_rows(path, file, line):
    """Number and cells (bytes) of each line that is not blank; the next one has number ``line``."""
    while text := file.readline(LONGEST + 1):
        if len(text) > LONGEST:
            raise too_long(path, line)
        if cells := text.split():
            yield line, cells
        line += 1


def text_columns(path, lines, rows, names):
    """Columns (n, k) of the next ``lines``, an iterator of numbers and cells. Raises DataError."""
    columns = rows.columns
    wanted = [columns.index(name) for name in names]
    # Grows with what is read, whatever the header announces.
    points = array("d")
    for number, cells in islice(lines, rows.points):
        try:
            values = _numbers(path, number, cells, columns)
        except DataError:
            is_last = len(points) // len(names) + 1 == rows.points
            if (not is_last or len(cells) < len(columns)) and next(lines, None) is None:
                raise cut_off(path, rows.points) from None
            raise
        points.extend([values[column] for column in wanted])
    if len(points) < len(names) * rows.points:
        raise cut_off(path, rows.points)
    return np.frombuffer(points).reshape(-1, len(names))


def _numbers(path, number, cells, columns):
    """The values of a line, all of which must be numbers."""
    if len(cells) != len(columns):
        raise wrong_width(path, number, len(cells), len(columns))
    try:
        values = list(map(float, cells))
    except ValueError:
        values = []
    # Python's 1_0 is no number in a file.
    if values and b"_" not in b"".join(cells):
        return values
    wrong = next(k for k, cell in enumerate(cells) if b"_" in cell or not _is_number(cell))
    text = cells[wrong].decode("utf-8", errors="replace")
    raise not_a_number(path, number, columns[wrong], text)


def _is_number(cell):
    try:
        float(cell)
    except ValueError:
        return False
    return True


def require_text_end(path, lines, rows):
    """Raise DataError if a line is left that the header does not account for."""
    for number, _ in lines:
        raise _too_much(f"{path}, line {number}", rows)


# Binary


def binary_columns(path, file, rows, names):
    """Columns (n, k) of the rows that are next in a binary file. Raises DataError."""
    if bytes_left(file) < rows.points * rows.bytes:
        raise cut_off(path, rows.points)
    points = np.empty((rows.points, len(names)))
    dtype = _columns_of_row(rows, names)
    step = max(1, BLOCK // rows.bytes)
    for start in range(0, rows.points, step):
        into = points[start : start + step]
        content = file.read(len(into) * rows.bytes)
        if len(content) < len(into) * rows.bytes:
            raise cut_off(path, rows.points)
        block = np.frombuffer(content, dtype)
        for column, name in enumerate(names):
            into[:, column] = as_doubles(block[name])
    return points


def as_doubles(values):
    """Values (n,) of any kind in double precision."""
    with np.errstate(invalid="ignore"):  # said of some of the bit patterns that are NaN
        return values.astype(float)


def _columns_of_row(rows, names):
    """The dtype of a row of which only the columns of these names are of interest."""
    offsets, kinds, position = {}, {}, 0
    for field in rows.fields:
        offsets[field.name], kinds[field.name] = position, field.kind
        position += field.bytes
    return np.dtype(
        {
            "names": list(names),
            "formats": [kinds[name] for name in names],
            "offsets": [offsets[name] for name in names],
            "itemsize": position,
        }
    )


def require_binary_end(path, file, rows, padding=b"\r\n", at_most=2):
    """Raise DataError if more is left than ``at_most`` bytes out of ``padding``."""
    rest = file.read(at_most + 1)
    if len(rest) > at_most or rest.strip(padding):
        raise _too_much(path, rows)


# Both


def cut_off(path, count, what="points"):
    """DataError: the file has less of something than the count in its header."""
    return DataError(
        f"{path}: the header says {count} {what}, but the file ends before the last one.",
        "the file is cut off, or its header is wrong; copy or export it again.",
    )


def _too_much(where, rows):
    return DataError(
        f"{where}: the header says {rows.points} points, but more follows after all that it"
        " announces.",
        f"the header may be wrong, so that points would be lost; {GET_AGAIN}",
    )
