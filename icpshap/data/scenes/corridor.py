"""A straight corridor of 36 m with doors in recesses, radiators and a passage to one side.

Little holds the pose along it: the doors, and its ends.
"""

from types import ModuleType

import numpy as np

from icpshap.data.scenes._parts import SENSOR_HEIGHT, box, cylinder, wall

LENGTH, WIDTH, HEIGHT = 36.0, 2.4, 2.6  # m
DOORS = ((2.0, 0), (5.5, 1), (9.0, 0), (14.5, 1), (17.0, 0), (24.5, 0), (27.0, 1), (32.0, 1))
DOOR, RECESS = (0.95, 2.05), 0.25  # m, width and height; depth
PASSAGE = (20.0, 21.8)  # m along the corridor


def build(open3d: ModuleType) -> list:
    """The meshes."""
    sides = {0: 0.0, 1: WIDTH}
    openings = {
        side: [(x, x + DOOR[0], 0.0, DOOR[1]) for x, of in DOORS if of == side] for side in sides
    }
    openings[1] = sorted([*openings[1], (*PASSAGE, 0.0, 2.3)])
    meshes = [
        box(open3d, (-0.1, -0.5, -0.1), (LENGTH + 0.1, WIDTH + 6.0, 0.0)),
        box(open3d, (-0.1, -0.5, HEIGHT), (LENGTH + 0.1, WIDTH + 6.0, HEIGHT + 0.1)),
        *wall(open3d, (0.0, 0.0), (0.0, WIDTH), HEIGHT),
        *wall(open3d, (LENGTH, 0.0), (LENGTH, WIDTH), HEIGHT),
        *(
            piece
            for side, y in sides.items()
            for piece in wall(open3d, (0.0, y), (LENGTH, y), HEIGHT, openings[side])
        ),
        *(piece for x in PASSAGE for piece in wall(open3d, (x, WIDTH), (x, WIDTH + 5.5), HEIGHT)),
        box(open3d, (PASSAGE[0], WIDTH + 5.4, 0.0), (PASSAGE[1], WIDTH + 5.5, HEIGHT)),
    ]
    for x, side in DOORS:
        y = sides[side] + (RECESS if side else -RECESS)
        meshes.append(box(open3d, (x, y - 0.03, 0.0), (x + DOOR[0], y + 0.03, DOOR[1])))
    for x in (7.0, 15.8, 29.5):  # radiators
        meshes.append(box(open3d, (x, 0.06, 0.15), (x + 1.1, 0.16, 0.75)))
    meshes.append(cylinder(open3d, (12.2, WIDTH - 0.2, 0.0), 0.12, 0.9))  # a bin
    meshes.append(box(open3d, (25.6, 0.08, 0.0), (26.2, 0.45, 1.1)))  # a cabinet
    return meshes


PATH = np.array(
    [(x, WIDTH / 2 + 0.15 * (-1) ** k, SENSOR_HEIGHT) for k, x in enumerate(range(2, 34, 4))]
)
