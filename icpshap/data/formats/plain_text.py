"""Plain text with a point in each line: blanks, commas or semicolons between its numbers."""

import re
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from icpshap.data.formats._lines import (
    AXES,
    LONGEST,
    is_number,
    not_a_number,
    too_long,
    wrong_width,
)
from icpshap.data.formats._names import (
    places_by_name,
    places_of,
    require_coordinates,
    unknown_columns,
)

SUFFIXES = (".xyz", ".txt")
SEPARATORS = (None, ",", ";")  # None: any number of blanks
COMMENTS = ("#", "//")


class Head(NamedTuple):
    """What precedes the points, and how their first line is written."""

    header: str  # the line that may name the columns, "" if there is none
    number: int  # of that line, counted from 1
    width: int
    separator: str | None


def read_columns(path: Path, columns: Sequence[str] | None, wanted: Sequence[str]) -> np.ndarray:
    """The `wanted` columns (n, k) of a file of these columns, whatever its first line says.

    Else this may name the columns, or the first three are x, y, z. Lines that begin with one of
    COMMENTS are left out; the last of them before the first point may name the columns too. Raises
    DataError.
    """
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        head = _head(path, file)
        if head is None:
            return np.empty((0, len(wanted)))
        named = None if columns else _named(path, head, wanted)
        places = named or places_of(path, head.width, columns, wanted)
        file.seek(0)
        points = _values(path, file, head, places)
    if not (named or columns):
        require_coordinates(path, points, head.width)
    return points


def _lines(path, file):
    """Number and text of each line that is not blank."""
    number = 0
    while line := file.readline(LONGEST + 1):
        number += 1
        if len(line) > LONGEST:
            raise too_long(path, number)
        if line.strip():
            yield number, line.strip()


def _head(path, file):
    """The `Head` of a file; None if it has no points."""
    header, header_number = "", 0
    for number, line in _lines(path, file):
        is_comment = line.startswith(COMMENTS)
        for separator in () if is_comment else SEPARATORS:
            cells = line.split(separator)
            if all(map(is_number, cells)):
                return Head(header, header_number, len(cells), separator)
        if header and not is_comment:
            raise unknown_columns(f"{path}, line {number}", [], line)
        header, header_number = line, number
    if header and not header.startswith(COMMENTS):
        # Points may have been meant.
        names = _names(header, None)
        if places_by_name(path, names, AXES) is None:
            raise unknown_columns(f"{path}, line {header_number}", names, header)
    return None


def _names(header, separator):
    text = header.lstrip("#/ \t")
    return [name.strip() for name in (text.split(separator) if separator else _words(text))]


def _words(text):
    return re.split(r"[\s,;]+", text.strip())


def _named(path, head, wanted):
    """Places of the wanted columns by the names in the header; None if it is a mere comment."""
    if not head.header:
        return None
    names = _names(head.header, head.separator)
    places = places_by_name(path, names, wanted) if len(names) == head.width else None
    if places is None and not head.header.startswith(COMMENTS):
        raise unknown_columns(f"{path}, line {head.number}", names, head.header)
    return places


def _values(path, file, head, places):
    """The columns at these places (n, k) of all lines but comments and the header."""
    points = array("d")
    for number, line in _lines(path, file):
        if number == head.number or line.startswith(COMMENTS):
            continue
        cells = line.split(head.separator)
        if len(cells) != head.width:
            raise wrong_width(path, number, len(cells), head.width)
        try:
            values = list(map(float, cells))
        except ValueError:
            values = []
        if not values or "_" in line:
            wrong = next(k for k, cell in enumerate(cells) if not is_number(cell))
            raise not_a_number(path, number, str(wrong + 1), cells[wrong].strip())
        points.extend([values[place] for place in places])
    return np.frombuffer(points).reshape(-1, len(places))
