"""Spatial order: points that follow one another are near one another.

Idea: cut the box of most of a cloud into 2^20 parts along each axis; the bits of the three numbers
of a point's part, taken in turns, are its place on a curve that fills the box (Morton, 1966). Where
a point comes does not depend on which others are used, so points that no run uses cost nothing.
Points outside count to the box's border: a far one does not put all others into one part.

Exactness: points of one part stay in the order of their rows.
"""

import numpy as np

PARTS = 2**20  # along each axis
SAMPLE = 10_000  # points that say where most are
# Shifts and masks that put two zeros between neighbouring bits.
SPREAD = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def spatial(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """`rows` (k,), ascending, of the points (n, 3) [m], in spatial order."""
    # Of a tenth of the points at either end of an axis nothing is known: one of them may be far.
    some = points[:: max(len(points) // SAMPLE, 1)]
    low, high = np.quantile(some, [0.1, 0.9], axis=0)
    extent = (high - low).max() or np.ptp(points, axis=0).max() or 1.0
    parts = (points[rows] - (low - 2.0 * extent)) / (5.0 * extent) * PARTS
    parts = np.clip(parts, 0, PARTS - 1).astype(np.int64)
    for shift, mask in SPREAD:
        parts = (parts | parts << shift) & mask
    return rows[np.argsort(parts @ [1, 2, 4], kind="stable")]
