"""The Polygon File Format, ASCII or binary: its vertices are the points."""

import os
import re
import struct
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from icpshap.data.formats._cloud import (
    Field,
    HeaderError,
    Rows,
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
from icpshap.data.formats._lines import AXES, shown, wrong_width
from icpshap.errors import DataError

SUFFIXES = (".ply", ".ply.gz")
KINDS = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
# numpy's kinds in the letters of `struct`, for the lengths of lists.
LETTERS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I"}


class Property(NamedTuple):
    """A property of an element; ``length`` is the kind of a list's length, "" for a number."""

    name: str
    kind: str
    length: str = ""


class Element(NamedTuple):
    """An element of the body: vertices, faces and the like, one after the other."""

    name: str
    number: int
    properties: list


class Header(NamedTuple):
    """What a header says of the body."""

    encoding: str  # one of BYTE_ORDERS
    elements: list

    @property
    def rows(self) -> Rows:
        """The vertices as `Rows`. Raises HeaderError where one has a list."""
        vertices = next(element for element in self.elements if element.name == "vertex")
        order = BYTE_ORDERS[self.encoding]
        return Rows(vertices.number, [Field(p.name, order + p.kind) for p in vertices.properties])


def read(path: Path) -> np.ndarray:
    """Points (n, 3) [m] of the vertices' properties x, y and z. Raises DataError."""
    return _read(path, AXES)


def read_timed(path: Path, time: str) -> np.ndarray:
    """The same with the property of the name ``time`` after them, (n, 4)."""
    return _read(path, (*AXES, time))


def _read(path, names):
    with opened(path) as file:
        header, line = read_header(path, ".ply", file, "end_header", _header)
        names = named_columns(path, header.rows, names)
        if header.encoding == "ascii":
            return _from_text(path, file, line, header, names)
        return _from_binary(path, file, header, names)


def _header(lines):
    """`Header` out of the lines of one."""
    encoding = None
    elements: list[Element] = []
    for words in lines:
        if lines.number == 1 and words != ["ply"]:
            raise HeaderError(f"{shown(' '.join(words))}, expected ply")
        match words:
            case ["ply"] if lines.number == 1:
                pass
            case ["comment" | "obj_info", *_] | ["end_header"]:
                pass
            case ["format", name, "1.0"] if name in BYTE_ORDERS and encoding is None:
                encoding = name
            case ["element", name, count]:
                if name in [element.name for element in elements]:
                    raise HeaderError(f"element {shown(name)} for a second time, expected once")
                elements.append(Element(name, whole_number(count, f"element {name}"), []))
            case ["property", *rest] if elements:
                elements[-1].properties.append(_property(rest))
            case _:
                raise HeaderError(f"{shown(' '.join(words))} is no line of such a header")
    return _checked(encoding, elements)


def _property(words):
    match words:
        case ["list", length, kind, name] if KINDS.get(length) in LETTERS and kind in KINDS:
            return Property(name, KINDS[kind], KINDS[length])
        case [kind, name] if kind in KINDS:
            return Property(name, KINDS[kind])
    raise HeaderError(f"property {shown(' '.join(words))}, expected a type that exists and a name")


def _checked(encoding, elements):
    if encoding is None:
        raise HeaderError(f"no format before it, expected one of {', '.join(BYTE_ORDERS)}")
    vertices = [element for element in elements if element.name == "vertex"]
    if not vertices:
        raise HeaderError("no element vertex before it")
    if lists := [p.name for p in vertices[0].properties if p.length]:
        raise HeaderError(f"the vertices have a list, {shown(lists[0])}, expected numbers")
    return Header(encoding, elements)


# What the header announces, in its order. Other elements than the vertices are gone through only to
# see that they are there, since else their bytes could as well be points.


def _from_text(path, file, line, header, names):
    lines = text_rows(path, file, line)
    points = None
    for element in header.elements:
        if element.name == "vertex":
            points = text_columns(path, lines, header.rows, names)
        elif element.properties:
            _skip_text(path, lines, element)
    require_text_end(path, lines, header.rows)
    return points


def _skip_text(path, lines, element):
    """Leave out the lines of an element; each must have the width that its lists say."""
    found = 0
    for line, cells in islice(lines, element.number):
        found += 1
        if len(cells) != (expected := _text_width(element, cells)):
            raise wrong_width(path, line, len(cells), expected)
    if found < element.number:
        raise cut_off(path, element.number, element.name)


def _text_width(element, cells):
    """How many cells a line has according to the lengths of the lists in it."""
    width = 0
    for item in element.properties:
        length = cells[width] if item.length and width < len(cells) else b"0"
        width += 1 + (int(length) if re.fullmatch(b"[0-9]{1,9}", length) else 0)
    return width


def _from_binary(path, file, header, names):
    points = None
    for element in header.elements:
        if element.name == "vertex":
            points = binary_columns(path, file, header.rows, names)
        elif any(item.length for item in element.properties):
            _skip_lists(path, file, element, BYTE_ORDERS[header.encoding])
        else:
            _skip_bytes(path, file, element, element.number * _row_bytes(element))
    require_binary_end(path, file, header.rows)
    return points


def _row_bytes(element):
    return sum(np.dtype(item.kind).itemsize for item in element.properties)


def _skip_lists(path, file, element, order):
    """Leave out the rows of an element with lists, whose lengths stand before them."""
    steps = [_step(item, order) for item in element.properties]
    for _ in range(element.number):
        for length, size, at_least in steps:
            if length:
                content = file.read(length.size)
                if len(content) < length.size:
                    raise cut_off(path, element.number, element.name)
                size *= (count := length.unpack(content)[0])
                if count < at_least:
                    raise DataError(
                        f"{path}: {element.name} has a list of {count}, expected {at_least} or"
                        " more.",
                        "the header may say another number of vertices than the file has; export"
                        " it again.",
                    )
            _skip_bytes(path, file, element, size)


def _step(item, order):
    """How to read a list's length, or None, the bytes of one value, and the shortest list."""
    length = struct.Struct(order + LETTERS[item.length]) if item.length else None
    # The corners of a face. Where points are taken for faces, such a number soon turns up.
    at_least = 3 if item.name in ("vertex_indices", "vertex_index") else 0
    return length, np.dtype(item.kind).itemsize, at_least


def _skip_bytes(path, file, element, size):
    if not 0 <= size <= bytes_left(file):
        raise cut_off(path, element.number, element.name)
    file.seek(size, os.SEEK_CUR)
