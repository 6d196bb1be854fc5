"""The Point Cloud Library's own format (Point Cloud Data), ASCII, binary or compressed."""

import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from icpshap.data.formats import _lzf
from icpshap.data.formats._cloud import (
    Field,
    HeaderError,
    Rows,
    as_doubles,
    binary_columns,
    bytes_left,
    cut_off,
    named_columns,
    read_header,
    require_binary_end,
    require_text_end,
    text_columns,
    text_rows,
    whole_number,
)
from icpshap.data.formats._gzip import opened
from icpshap.data.formats._lines import AXES, GET_AGAIN, shown
from icpshap.errors import DataError

SUFFIXES = (".pcd", ".pcd.gz")
KEYWORDS = (
    *("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT"),
    *("WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"),
)
KINDS = {
    **{("F", size): f"<f{size}" for size in ("4", "8")},
    **{("I", size): f"<i{size}" for size in ("1", "2", "4", "8")},
    **{("U", size): f"<u{size}" for size in ("1", "2", "4", "8")},
}
ENCODINGS = ("ascii", "binary", "binary_compressed")
# The library's own writer makes some files longer by a page of memory, which stays zero.
PAGE = 2**16


class Header(NamedTuple):
    """What a header says of the body."""

    encoding: str  # one of ENCODINGS
    rows: Rows


def read(path: Path) -> np.ndarray:
    """Points (n, 3) [m] of the fields x, y and z. Raises DataError."""
    return _read(path, AXES)


def read_timed(path: Path, time: str) -> np.ndarray:
    """The same with the field of the name ``time`` after them, (n, 4)."""
    return _read(path, (*AXES, time))


def _read(path, names):
    with opened(path) as file:
        (encoding, rows), line = read_header(path, ".pcd", file, "DATA", _header)
        names = named_columns(path, rows, names)
        if encoding == "ascii":
            lines = text_rows(path, file, line)
            points = text_columns(path, lines, rows, names)
            require_text_end(path, lines, rows)
            return points
        points = {"binary": binary_columns, "binary_compressed": _compressed_columns}[encoding](
            path, file, rows, names
        )
        require_binary_end(path, file, rows, padding=b"\0", at_most=PAGE)
        return points


def _header(lines):
    """`Header` out of the lines of one."""
    entries = {}
    for words in lines:
        if words[0].startswith("#"):
            continue
        if words[0] not in KEYWORDS:
            raise HeaderError(f"{shown(words[0])}, expected one of {', '.join(KEYWORDS)}")
        if words[0] in entries:
            raise HeaderError(f"{words[0]} for a second time, expected once")
        entries[words[0]] = (lines.number, words[1:])
    encoding = _one(entries, "DATA")
    if encoding not in ENCODINGS:
        raise HeaderError(f"DATA {shown(encoding)}, expected one of {', '.join(ENCODINGS)}")
    return Header(encoding, Rows(_points(entries), _fields(entries)))


def _entry(entries, keyword):
    """Number and values of the line of a keyword. Raises HeaderError if there is none."""
    if keyword not in entries:
        raise HeaderError(f"no {keyword} before it")
    return entries[keyword]


def _one(entries, keyword):
    line, values = _entry(entries, keyword)
    if len(values) != 1:
        raise HeaderError(f"{keyword} has {len(values)} values, expected one", line)
    return values[0]


def _count(entries, keyword):
    text = _one(entries, keyword)
    return whole_number(text, keyword, entries[keyword][0])


def _points(entries):
    """The number of points, about which POINTS and WIDTH x HEIGHT must agree."""
    points = _count(entries, "POINTS")
    if "WIDTH" in entries and "HEIGHT" in entries:
        width, height = _count(entries, "WIDTH"), _count(entries, "HEIGHT")
        if width * height != points:
            raise HeaderError(
                f"POINTS {points}, expected WIDTH {width} x HEIGHT {height} = {width * height}",
                entries["POINTS"][0],
            )
    return points


def _fields(entries):
    names = _entry(entries, "FIELDS")[1]
    size_line, sizes = _entry(entries, "SIZE")
    type_line, types = _entry(entries, "TYPE")
    count_line, counts = entries.get("COUNT", (None, ["1"] * len(names)))
    for keyword, values in (("SIZE", sizes), ("TYPE", types), ("COUNT", counts)):
        if len(values) != len(names):
            raise HeaderError(
                f"{keyword} has {len(values)} values for {len(names)} FIELDS, expected one each",
                entries[keyword][0],
            )
    fields = []
    for name, size, letter, text in zip(names, sizes, types, counts, strict=True):
        if (letter, size) not in KINDS:
            raise HeaderError(
                f"TYPE {shown(letter)} of SIZE {shown(size)} (line {size_line}), expected F of 4 or"
                " 8 bytes, or I or U of 1, 2, 4 or 8",
                type_line,
            )
        count = whole_number(text, "COUNT", count_line)
        if not count:
            raise HeaderError("COUNT 0, expected at least 1", count_line)
        fields.append(Field(name, KINDS[letter, size], count))
    return fields


def _compressed_columns(path, file, rows, names):
    """Columns (n, k) of a body that is compressed, in which all of x precedes all of y.

    Its two sizes are compared with the header and the file before anything is unpacked.
    """
    sizes = file.read(8)
    if len(sizes) < 8:
        raise cut_off(path, rows.points)
    packed, unpacked = struct.unpack("<II", sizes)
    if packed > bytes_left(file):
        raise cut_off(path, rows.points)
    if unpacked != rows.points * rows.bytes:
        raise DataError(
            f"{path}: {unpacked} bytes when decompressed, expected {rows.points * rows.bytes}: the"
            f" header says {rows.points} points of {rows.bytes} bytes.",
            "the header was changed, or the file is damaged; export it again.",
        )
    content = _unpacked(path, file.read(packed), unpacked)
    points = np.empty((rows.points, len(names)))
    position = 0
    for field in rows.fields:
        if field.name in names:
            column = np.frombuffer(content, field.kind, rows.points, position)
            points[:, names.index(field.name)] = as_doubles(column)
        position += field.bytes * rows.points
    return points


def _unpacked(path, packed, size):
    try:
        if size > len(packed) * _lzf.MAXIMUM_EXPANSION:
            raise ValueError("more than so few can stand for")
        return _lzf.decompress(packed, size)
    except ValueError as error:
        raise DataError(
            f"{path}: {len(packed)} compressed bytes, expected to stand for {size}: {error}.",
            f"the data are damaged; {GET_AGAIN}",
        ) from None
