"""Comma-separated values: the data set's ``Hokuyo_<i>.csv``, or a user's own table."""

import csv
import re

import numpy as np
import pyarrow as pa
import pyarrow.csv

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
from icpshap.errors import DataError

SUFFIXES = (".csv",)


def read(path):
    """Points (n, 3) [m] in the columns x, y and z, which a header line names; others are ignored.

    Raises DataError.
    """
    return _read(path, AXES)


def read_timed(path, time):
    """The same with the column of the name ``time`` after them, (n, 4)."""
    return _read(path, (*AXES, time))


def _read(path, wanted):
    with path.open("rb") as file:
        names = _column_names(path, file)
        for time in wanted[len(AXES) :]:
            if names.count(time) != 1:
                raise no_time_column(path, time, names)
        table = _read_table(path, file, names, wanted)
        _require_all_lines(path, file, len(table))
    points = np.empty((len(table), len(wanted)))
    for column, name in enumerate(wanted):
        points[:, column] = table[name]
    return points


def _column_names(path, file):
    """Names of the columns according to the first line."""
    line = file.readline(LONGEST + 1)
    if len(line) > LONGEST:
        raise too_long(path, 1)
    header = line.decode("utf-8-sig", errors="replace").rstrip("\r\n")
    try:
        names = [name.strip() for name in next(csv.reader([header]), [])]
    except csv.Error:
        names = []
    if any(names.count(axis) != 1 for axis in "xyz"):
        raise DataError(
            f"{path}, line 1: expected a header with the columns x, y and z, each once, separated"
            f" by commas; found {shown(header.strip())}.",
            "the file may be empty or of another format; name the columns in its first line."
            if b"\0" not in line
            else "the file is not in UTF-8; save it so, with the columns named in its first line.",
        )
    return names


def _read_table(path, file, names, wanted):
    """The wanted columns of all rows below the header, as a table of pyarrow."""
    file.seek(0)
    try:
        return pa.csv.read_csv(
            file,
            # Only the single-threaded parser knows the row number of an error.
            read_options=pa.csv.ReadOptions(use_threads=False, skip_rows=1, column_names=names),
            convert_options=pa.csv.ConvertOptions(
                include_columns=list(wanted),
                column_types=dict.fromkeys(wanted, pa.float64()),
                null_values=[],
            ),
        )
    except pa.ArrowInvalid as error:
        raise _csv_error(path, file, names, str(error)) from None


def _csv_error(path, file, names, message):
    """DataError for what pyarrow's parser says."""
    if match := re.search(r"Row #(\d+): Expected (\d+) columns, got (\d+)", message):
        row, expected, found = map(int, match.groups())
        return wrong_width(path, _line_of_row(file, row), found, expected)
    if match := re.search(r"column #(\d+): Row #(\d+): .* invalid value '(.*)'", message, re.S):
        column, row, value = match.groups()
        return not_a_number(path, _line_of_row(file, int(row)), names[int(column)], value)
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


def _require_all_lines(path, file, rows):
    """Raise DataError unless each line became a row: a quoted cell swallows line ends."""
    lines = sum(1 for _ in _filled_lines(file)) - 1
    if lines != rows:
        raise DataError(
            f"{path}: {rows} rows in {lines} lines below the header, expected one each.",
            "a quotation mark may be missing, or lines may end in different ways; write the file"
            " without quotation marks.",
        )
