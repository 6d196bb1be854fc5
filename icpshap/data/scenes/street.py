"""A street of 80 m between houses, with parked cars, poles and trees."""

from types import ModuleType

import numpy as np

from icpshap.data.scenes._parts import SENSOR_HEIGHT, box, cylinder, sphere

HALF_WIDTH, KERB = 8.0, 4.0  # m
# From, to along the street, how far behind the building line, height [m].
HOUSES = {
    -1: (
        (-40, -27, 0.0, 9.0), (-27, -14, 0.8, 11.0), (-11, 3, 0.0, 8.0), (3, 17, 0.4, 12.0),
        (21, 40, 0.0, 9.5),
    ),
    1: (
        (-40, -21, 0.5, 10.0), (-18, -6, 0.0, 8.5), (-6, 9, 1.0, 11.5), (9, 24, 0.0, 9.0),
        (27, 40, 0.6, 10.5),
    ),
}  # fmt: skip
CARS = (
    (-30.5, -1), (-24.0, 1), (-17.0, -1), (-9.5, 1), (-4.0, 1), (1.5, -1), (8.0, 1), (16.5, -1),
    (22.0, -1), (29.0, 1),
)  # fmt: skip
POLES = (-33.0, -15.5, -1.0, 13.0, 31.0)
TREES = ((-28.0, 1), (-12.5, -1), (5.0, 1), (19.0, 1), (25.5, -1))


def build(open3d: ModuleType) -> list:
    """The meshes."""
    meshes = [box(open3d, (-45.0, -25.0, -0.2), (45.0, 25.0, 0.0))]
    for side, houses in HOUSES.items():
        pavement = sorted((side * KERB, side * 25.0))
        meshes.append(box(open3d, (-45.0, pavement[0], 0.0), (45.0, pavement[1], 0.12)))
        for start, end, behind, top in houses:
            meshes += _house(open3d, side, start, end, HALF_WIDTH + behind, top)
    for x, side in CARS:
        y = side * (KERB - 1.1)
        meshes.append(box(open3d, (x - 2.1, y - 0.9, 0.25), (x + 2.1, y + 0.9, 0.85)))
        meshes.append(box(open3d, (x - 1.1, y - 0.8, 0.85), (x + 1.2, y + 0.8, 1.45)))
    for k, x in enumerate(POLES):
        meshes.append(cylinder(open3d, (x, (-1) ** k * (KERB + 0.5), 0.0), 0.08, 6.0))
    for x, side in TREES:
        base = (x, side * (KERB + 1.2), 0.0)
        meshes.append(cylinder(open3d, base, 0.18, 2.6))
        meshes.append(sphere(open3d, np.add(base, (0, 0, 3.8)), 1.5))
    return meshes


def _house(open3d, side, start, end, line, top):
    """A block whose front has bays of windows."""
    front = sorted((side * line, side * (line + 8.0)))
    meshes = [box(open3d, (start, front[0], 0.0), (end, front[1], top))]
    for x in np.arange(start + 1.2, end - 1.5, 2.9):
        for z in np.arange(0.9, top - 1.6, 2.8):
            sill = sorted((side * line, side * (line - 0.15)))
            meshes.append(box(open3d, (x, sill[0], z), (x + 1.3, sill[1], z + 0.12)))
            meshes.append(box(open3d, (x, sill[0], z + 1.5), (x + 1.3, sill[1], z + 1.62)))
    return meshes


PATH = np.array(
    [(x, -1.5 + 0.3 * (-1) ** k, SENSOR_HEIGHT) for k, x in enumerate(range(-14, 18, 4))],
    dtype=float,
)
