"""A hall of 26 m x 18 m and 7 m height with pillars, crates and a gallery."""

from types import ModuleType

import numpy as np

from icpshap.data.scenes._parts import SENSOR_HEIGHT, box, cylinder, wall

LENGTH, WIDTH, HEIGHT = 26.0, 18.0, 7.0  # m
PILLARS = [(5.0 * column + 3.0, 5.0 * row + 4.0) for column in range(5) for row in range(3)]
CRATES = (
    ((1.0, 0.5), (2.4, 1.6), 1.3), ((2.6, 0.5), (3.4, 1.2), 0.8), ((9.5, 16.2), (11.5, 17.4), 1.8),
    ((14.2, 6.2), (15.6, 7.1), 1.1), ((19.6, 1.0), (22.0, 2.2), 2.2),
    ((22.4, 12.0), (23.4, 13.4), 0.9), ((6.0, 11.0), (7.0, 12.2), 1.0),
    ((24.6, 4.0), (25.8, 8.0), 1.6),
)  # fmt: skip


def build(open3d: ModuleType) -> list:
    """The meshes."""
    corners = [(0.0, 0.0), (LENGTH, 0.0), (LENGTH, WIDTH), (0.0, WIDTH)]
    gate = (10.0, 14.0, 0.0, 4.0)
    meshes = [
        box(open3d, (-0.1, -0.1, -0.1), (LENGTH + 0.1, WIDTH + 0.1, 0.0)),
        box(open3d, (-0.1, -0.1, HEIGHT), (LENGTH + 0.1, WIDTH + 0.1, HEIGHT + 0.1)),
        *wall(open3d, corners[0], corners[1], HEIGHT, [gate]),
        *wall(open3d, corners[3], corners[2], HEIGHT),
        *wall(open3d, corners[0], corners[3], HEIGHT),
        *wall(open3d, corners[1], corners[2], HEIGHT),
        box(open3d, (0.0, 15.0, 3.4), (LENGTH, WIDTH, 3.6)),  # the gallery
        *(box(open3d, (x, 0.0, 6.4), (x + 0.3, WIDTH, HEIGHT)) for x in np.arange(3.0, 26.0, 5.0)),
    ]
    meshes += [cylinder(open3d, (x, y, 0.0), 0.25, HEIGHT) for x, y in PILLARS]
    return meshes + [box(open3d, (*low, 0.0), (*high, top)) for low, high, top in CRATES]


PATH = np.array(
    [
        (x, y, SENSOR_HEIGHT)
        for x, y in [(2, 2.5), (6, 2), (10.5, 3), (13, 6.5), (10, 9), (5.5, 8), (6, 13.5), (12, 14)]
    ],
    dtype=float,
)
