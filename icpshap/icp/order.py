"""Spatial order: points that follow one another are near one another.

Idea: cut the box of a cloud into 2^20 parts along each axis; the bits of the three numbers of a
point's part, taken in turns, are its place on a curve that fills the box (Morton, 1966). So where a
point comes does not depend on which others are used: points that no run uses cost nothing.

Exactness: points of one part stay in the order of their rows.
"""

import numpy as np

PARTS = 2**20  # along each axis
# Shifts and masks that put two zeros between neighbouring bits.
SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def spatial(points, rows):
    """`rows` (k,), ascending, of the points (n, 3) [m], in spatial order."""
    low = np.array([column.min() for column in points.T])
    extent = max(column.max() - least for column, least in zip(points.T, low, strict=True))
    scale = (PARTS - 1) / extent if extent > 0 else 0.0
    parts = ((points[rows] - low) * scale).astype(np.int64)
    for shift, mask in SPREAD:
        parts = (parts | parts << shift) & mask
    return rows[np.argsort(parts @ [1, 2, 4], kind="stable")]
