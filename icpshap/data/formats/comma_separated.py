"""Separated values: the data set's ``Hokuyo_<i>.csv``, or a user's own table."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv

from icpshap.data.formats._lines import (
    AXES,
    GET_AGAIN,
    LONGEST,
    is_number,
    not_a_number,
    shown,
    too_long,
    wrong_width,
)
from icpshap.data.formats._names import (
    named_axes,
    places_by_name,
    places_of,
    require_coordinates,
    unknown_columns,
)
from icpshap.errors import DataError

SUFFIXES = (".csv",)
SEPARATORS = (",", ";", "\t")


class Layout(NamedTuple):
    """How the rows of a file are written."""

    separator: str
    names: list  # of the columns; their numbers, as text, where there is no header
    wanted: list  # the names of the columns that are read
    has_header: bool


def read_columns(path: Path, columns: Sequence[str] | None, wanted: Sequence[str]) -> np.ndarray:
    """The `wanted` columns (n, k) of a file of these columns, whatever its first line says.

    Else this names the columns, of which others are ignored; without it, x, y and z are the first
    three. Raises DataError.
    """
    with path.open("rb") as file:
        layout = _layout(path, file, columns, wanted)
        table = _read_table(path, file, layout)
        _require_all_lines(path, file, len(table), layout)
    points = np.empty((len(table), len(wanted)))
    for column, name in enumerate(layout.wanted):
        points[:, column] = table[name]
    if columns is None and not layout.has_header:
        require_coordinates(path, points, len(layout.names))
    return points


def _layout(path, file, columns, wanted):
    """The `Layout` that the first line shows."""
    line = file.readline(LONGEST + 1)
    if len(line) > LONGEST:
        raise too_long(path, 1)
    header = line.decode("utf-8-sig", errors="replace").rstrip("\r\n")
    for separator in SEPARATORS:
        cells = _cells(header, separator)
        has_header = not all(map(is_number, cells))
        if not has_header and len(cells) >= len(AXES):
            names = [str(number + 1) for number in range(len(cells))]
            places = places_of(path, len(cells), columns, wanted)
            return Layout(separator, names, [names[place] for place in places], False)
        if has_header and columns and len(cells) == len(columns):
            places = places_of(path, len(cells), columns, wanted)
            return Layout(separator, columns, [columns[place] for place in places], True)
        if has_header and not columns and (places := places_by_name(path, cells, wanted)):
            return Layout(separator, cells, [cells[place] for place in places], True)
    raise _no_layout(path, line, header, columns)


def _cells(line, separator):
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
    except csv.Error:
        return []


def _no_layout(path, line, header, columns):
    """DataError: the first line, in bytes and as a header, shows no layout."""
    if b"\0" in line:
        return DataError(
            f"{path}, line 1: expected a header with the columns x, y and z, each once; found"
            f" {shown(header.strip())}.",
            "the file is not in UTF-8; save it so, with the columns named in its first line.",
        )
    rows = [_cells(header, separator) for separator in SEPARATORS]
    if columns:
        return wrong_width(path, 1, max(map(len, rows)), len(columns))
    fullest = max(rows, key=lambda cells: sum(map(bool, named_axes(cells))))
    return unknown_columns(f"{path}, line 1", fullest, header.strip())


def _read_table(path, file, layout):
    """The wanted columns of all rows below the header, as a table of pyarrow."""
    file.seek(0)
    try:
        return pa.csv.read_csv(
            file,
            # Only the single-threaded parser knows the row number of an error.
            read_options=pa.csv.ReadOptions(
                use_threads=False, skip_rows=int(layout.has_header), column_names=layout.names
            ),
            parse_options=pa.csv.ParseOptions(delimiter=layout.separator),
            convert_options=pa.csv.ConvertOptions(
                include_columns=layout.wanted,
                column_types=dict.fromkeys(layout.wanted, pa.float64()),
                null_values=[],
            ),
        )
    except pa.ArrowInvalid as error:
        raise _csv_error(path, file, layout.names, str(error)) from None


def _csv_error(path, file, names, message):
    """DataError for what pyarrow's parser says."""
    if match := re.search(r"Row #(\d+): Expected (\d+) columns, got (\d+)", message):
        row, expected, found = map(int, match.groups())
        return wrong_width(path, _line_of_row(file, row), found, expected)
    if match := re.search(r"column #(\d+): Row #(\d+): .* invalid value '(.*)'", message, re.S):
        column, number, value = match.groups()
        return not_a_number(path, _line_of_row(file, int(number)), names[int(column)], value)
    return DataError(f"{path}: {message}", GET_AGAIN)


def _filled_lines(file):
    """Numbers of the lines that are not empty: the rows of pyarrow, the header included."""
    file.seek(0)
    return (number for number, line in enumerate(file, start=1) if line.strip(b"\r\n"))


def _line_of_row(file, row):
    """The line in which a row begins, both counted from 1."""
    for count, number in enumerate(_filled_lines(file), start=1):
        if count == row:
            return number
    return row


def _require_all_lines(path, file, rows, layout):
    """Raise DataError unless each line became a row: a quoted cell swallows line ends."""
    lines = sum(1 for _ in _filled_lines(file)) - layout.has_header
    if lines != rows:
        raise DataError(
            f"{path}: {rows} rows in {lines} lines{' below the header' * layout.has_header},"
            " expected one each.",
            "a quotation mark may be missing, or lines may end in different ways; write the file"
            " without quotation marks.",
        )
