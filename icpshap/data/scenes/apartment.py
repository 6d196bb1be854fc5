"""Four furnished rooms, 10 m x 8 m, with doors and windows."""

from types import ModuleType

import numpy as np

from icpshap.data.scenes._parts import SENSOR_HEIGHT, box, cylinder, sphere, wall


def _table(open3d, low, high, height):
    """A top on four legs above the rectangle from ``low`` to ``high``."""
    legs = [
        box(open3d, (x, y, 0.0), (x + 0.06, y + 0.06, height - 0.04))
        for x in (low[0], high[0] - 0.06)
        for y in (low[1], high[1] - 0.06)
    ]
    return [*legs, box(open3d, (*low, height - 0.04), (*high, height))]


def _chair(open3d, x, y):
    seat = _table(open3d, (x, y), (x + 0.42, y + 0.42), 0.46)
    return [*seat, box(open3d, (x, y, 0.46), (x + 0.04, y + 0.42, 0.95))]


def _shelf(open3d, low, high, height):
    """A bookcase: sides, boards every 0.4 m, open in between."""
    (x0, y0), (x1, y1) = low, high
    boards = [box(open3d, (x0, y0, z), (x1, y1, z + 0.03)) for z in np.arange(0.05, height, 0.4)]
    if x1 - x0 > y1 - y0:
        sides = [((x0, y0), (x0 + 0.03, y1)), ((x1 - 0.03, y0), (x1, y1))]
    else:
        sides = [((x0, y0), (x1, y0 + 0.03)), ((x0, y1 - 0.03), (x1, y1))]
    return boards + [box(open3d, (*a, 0.0), (*b, height)) for a, b in sides]


def build(open3d: ModuleType) -> list:
    """The meshes."""
    height, door, window = 2.6, (0.0, 2.0), (0.9, 2.1)
    meshes = [
        box(open3d, (-0.1, -0.1, -0.1), (10.1, 8.1, 0.0)),
        box(open3d, (-0.1, -0.1, height), (10.1, 8.1, height + 0.1)),
        *wall(open3d, (0.0, 0.0), (10.0, 0.0), height, [(1.5, 3.5, *window), (7.2, 8.6, *window)]),
        *wall(open3d, (0.0, 8.0), (10.0, 8.0), height, [(1.0, 2.2, *window), (8.0, 9.2, *window)]),
        *wall(open3d, (0.0, 0.0), (0.0, 8.0), height),
        *wall(open3d, (10.0, 0.0), (10.0, 8.0), height),
        *wall(open3d, (6.0, 0.0), (6.0, 8.0), height, [(2.0, 2.9, *door), (6.2, 7.1, *door)]),
        *wall(open3d, (0.0, 5.0), (6.0, 5.0), height, [(2.5, 4.0, *door)]),
        *wall(open3d, (6.0, 4.5), (10.0, 4.5), height, [(7.5, 8.4, *door)]),
    ]
    living_room = [
        box(open3d, (0.1, 2.2, 0.0), (0.9, 4.2, 0.42)),  # sofa
        box(open3d, (0.1, 2.2, 0.42), (0.3, 4.2, 0.85)),
        *_table(open3d, (1.2, 4.2), (1.9, 4.8), 0.45),
        *_shelf(open3d, (4.3, 4.6), (5.8, 4.93), 2.1),
        box(open3d, (4.9, 0.1, 0.0), (5.9, 0.5, 0.75)),  # sideboard
        box(open3d, (5.1, 0.15, 0.8), (5.8, 0.2, 1.25)),  # television
        cylinder(open3d, (0.4, 0.5, 0.0), 0.18, 0.4),  # plant
        sphere(open3d, (0.4, 0.5, 0.75), 0.38),
    ]
    kitchen = [
        box(open3d, (0.1, 7.4, 0.0), (3.6, 7.93, 0.9)),
        box(open3d, (2.6, 7.6, 1.4), (4.2, 7.93, 2.1)),
        box(open3d, (4.9, 7.3, 0.0), (5.6, 7.93, 1.9)),  # refrigerator
        *_table(open3d, (0.4, 5.5), (1.8, 6.4), 0.74),
        *_chair(open3d, 1.9, 5.7),
        *_chair(open3d, 0.8, 6.5),
    ]
    bedroom = [
        box(open3d, (8.3, 0.5, 0.0), (9.9, 1.9, 0.5)),  # bed
        box(open3d, (9.8, 0.4, 0.0), (9.93, 2.0, 1.0)),
        box(open3d, (9.3, 2.6, 0.0), (9.93, 4.3, 2.1)),  # wardrobe
        *_table(open3d, (6.15, 0.2), (7.0, 1.1), 0.74),
    ]
    study = [
        *_table(open3d, (8.9, 5.2), (9.7, 6.9), 0.74),
        *_chair(open3d, 8.4, 5.6),
        *_shelf(open3d, (6.1, 4.9), (6.43, 6.0), 2.1),
        box(open3d, (6.3, 7.5, 0.0), (7.5, 7.93, 1.2)),
    ]
    return [*meshes, *living_room, *kitchen, *bedroom, *study]


CORNERS = [
    (1.5, 1.2), (3.8, 1.6), (6.0, 2.45), (7.6, 2.8), (7.95, 4.5), (7.7, 6.1),
    (6.0, 6.65), (4.0, 6.4), (3.2, 5.0), (2.8, 3.4), (1.6, 1.8),
]  # fmt: skip
PATH = np.array([(x, y, SENSOR_HEIGHT) for x, y in CORNERS])
