"""Spatial order: points that follow one another are near one another.

Idea: cut the box of a cloud into 2^20 parts along each axis; the bits of the three numbers of a
point's part, taken in turns, are its place on a curve that fills the box (Morton, 1966). So where a
point comes does not depend on which others are used: points that no run uses cost nothing.

Exactness: points of one part stay in the order of their rows.

Measured: docs/engine.md.
"""

import numpy as np

from icpshap.icp.compiled import jit

PARTS = 2**20  # along each axis


@jit
def _spread(bits):
    """The last 21 bits, two zeros between neighbours."""
    bits &= 0x1FFFFF
    bits = (bits | bits << 32) & 0x1F00000000FFFF
    bits = (bits | bits << 16) & 0x1F0000FF0000FF
    bits = (bits | bits << 8) & 0x100F00F00F00F00F
    bits = (bits | bits << 4) & 0x10C30C30C30C30C3
    return (bits | bits << 2) & 0x1249249249249249


@jit
def _places(points, rows):
    low, high = points[0].copy(), points[0].copy()
    for k in range(len(points)):
        for axis in range(3):
            low[axis] = min(low[axis], points[k, axis])
            high[axis] = max(high[axis], points[k, axis])
    extent = (high - low).max()
    parts_per_metre = (PARTS - 1) / extent if extent > 0.0 else 0.0
    result = np.empty(len(rows), np.int64)
    for k in range(len(rows)):
        place = 0
        for axis in range(3):
            part = np.int64((points[rows[k], axis] - low[axis]) * parts_per_metre)
            place |= _spread(part) << axis
        result[k] = place
    return result


def spatial(points, rows):
    """`rows` (k,), ascending, of the points (n, 3) [m], in spatial order."""
    places = _places(points, rows)
    return rows[np.argsort(places, kind="stable")]
