"""Builders of small scan files and archives, whole or with one thing wrong."""

import struct
import zipfile

import numpy as np

POINTS = np.random.default_rng(8).normal(0, 5, (40, 3)).astype("<f4")
COUNT = len(POINTS)
BODY = POINTS.tobytes()
COLUMNS = POINTS.T.tobytes()  # all of x, then all of y


def ply(*elements, body=BODY, encoding="binary_little_endian", vertices=COUNT, kind="float"):
    """A .ply file; ``elements``: lines of the header after those of the vertices."""
    lines = [
        *("ply", f"format {encoding} 1.0", f"element vertex {vertices}"),
        *(f"property {kind} {axis}" for axis in "xyz"),
        *(*elements, "end_header", ""),
    ]
    return "\n".join(lines).encode() + bytes(body)


def pcd(data="binary", body=BODY, **changed):
    """A .pcd file; ``changed``: what entries of the header say, None for none."""
    entries = {
        **{"VERSION": "0.7", "FIELDS": "x y z", "SIZE": "4 4 4", "TYPE": "F F F"},
        **{"COUNT": "1 1 1", "WIDTH": COUNT, "HEIGHT": 1},
        **{"VIEWPOINT": "0 0 0 1 0 0 0", "POINTS": COUNT, **changed, "DATA": data},
    }
    lines = [f"{key} {value}\n" for key, value in entries.items() if value is not None]
    return "".join(lines).encode() + body


def literals(content):
    """LZF of bytes that does not compress them."""
    pieces = [content[at : at + 32] for at in range(0, len(content), 32)]
    return b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)


def packed(content=COLUMNS, lzf=None, packed_bytes=None, unpacked_bytes=None):
    """The body of a compressed .pcd file; the sizes can be made to lie."""
    lzf = literals(content) if lzf is None else lzf
    sizes = (packed_bytes, len(lzf)), (unpacked_bytes, len(content))
    return struct.pack("<II", *(true if lie is None else lie for lie, true in sizes)) + lzf


def compressed(body=None, **changed):
    """A .pcd file of compressed data."""
    return pcd("binary_compressed", packed() if body is None else body, **changed)


def text(points=POINTS, separator=" "):
    """Rows of numbers, every digit of them."""
    return "".join(
        separator.join(map(repr, row)) + "\n" for row in points.astype(float).tolist()
    ).encode()


def csv(rows=None, header=b"x,y,z\n"):
    return header + (text(separator=",") if rows is None else rows)


SCAN, POSES = "r/csv_local/Hokuyo_0.csv", "r/leica/pose_scanner_leica.csv"


def zipped(path, members, method=zipfile.ZIP_DEFLATED):
    """An archive of members: (name or `ZipInfo`, content)."""
    with zipfile.ZipFile(path, "w") as archive:
        for member, content in members:
            archive.writestr(member, content, method)
    return path


def edited(path, *edits):
    """The archive with fields of its directory replaced: (member's number, offset, bytes)."""
    content = bytearray(path.read_bytes())
    starts = [at for at in range(len(content)) if content[at : at + 4] == b"PK\1\2"]
    for number, offset, value in edits:
        content[starts[number] + offset : starts[number] + offset + len(value)] = value
    path.write_bytes(content)
    return path
