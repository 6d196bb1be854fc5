"""A shaft with three storeys of two flights each, with landings and railings."""

from types import ModuleType

import numpy as np

from icpshap.data.scenes._parts import SENSOR_HEIGHT, box, wall

FLIGHT_STEPS, RISE, TREAD = 9, 0.17, 0.28  # m
LANDING, FLIGHT_WIDTH, WELL = 2.2, 2.2, 0.4  # m; the well is the gap between the flights
STOREYS = 3
HALF_STOREY = FLIGHT_STEPS * RISE
FLIGHT_LENGTH = FLIGHT_STEPS * TREAD
STAIR_WIDTH = 2 * FLIGHT_WIDTH + WELL
STAIR_LENGTH = 2 * LANDING + FLIGHT_LENGTH


def build(open3d: ModuleType) -> list:
    """The meshes."""
    top = 2 * STOREYS * HALF_STOREY + 2.6
    far = LANDING + FLIGHT_LENGTH
    meshes = [
        box(open3d, (0, 0, -0.1), (STAIR_WIDTH, STAIR_LENGTH, 0.0)),
        box(open3d, (0, 0, top), (STAIR_WIDTH, STAIR_LENGTH, top + 0.1)),
        *wall(open3d, (0.0, 0.0), (0.0, STAIR_LENGTH), top),
        *wall(open3d, (STAIR_WIDTH, 0.0), (STAIR_WIDTH, STAIR_LENGTH), top),
        *wall(open3d, (0.0, 0.0), (STAIR_WIDTH, 0.0), top),
        *wall(open3d, (0.0, STAIR_LENGTH), (STAIR_WIDTH, STAIR_LENGTH), top),
    ]
    for half in range(2 * STOREYS):
        ground = half * HALF_STOREY
        upward = half % 2 == 0  # this flight leads to the far landing, on the low-x side
        left = 0.0 if upward else FLIGHT_WIDTH + WELL
        rail = FLIGHT_WIDTH if upward else FLIGHT_WIDTH + WELL - 0.04
        for step in range(FLIGHT_STEPS):
            y = LANDING + TREAD * step if upward else far - TREAD * (step + 1)
            z = ground + RISE * (step + 1)
            meshes.append(box(open3d, (left, y, z - 0.2), (left + FLIGHT_WIDTH, y + TREAD, z)))
            meshes.append(box(open3d, (rail, y + 0.12, z), (rail + 0.04, y + 0.16, z + 0.95)))
        z = ground + HALF_STOREY
        start = far if upward else 0.0
        meshes.append(box(open3d, (0, start, z - 0.2), (STAIR_WIDTH, start + LANDING, z)))
    for storey in range(STOREYS + 1):
        z = 2 * storey * HALF_STOREY
        meshes.append(box(open3d, (1.0, 0.05, z), (1.9, 0.12, z + 2.0)))  # door
        meshes.append(box(open3d, (0.05, 0.3, z), (0.35, 0.9, z + 0.8)))  # radiator
    return meshes


def _path():
    left, right = 0.65 * FLIGHT_WIDTH, STAIR_WIDTH - 0.65 * FLIGHT_WIDTH
    near, far = LANDING, LANDING + FLIGHT_LENGTH
    corners = [(left + 0.3, near - 1.1, 0.0)]
    for half in range(2 * STOREYS):
        low, high = half * HALF_STOREY, (half + 1) * HALF_STOREY
        if half % 2 == 0:
            turn = (STAIR_WIDTH / 2, far + 1.1, high)
            corners += [(left, near, low), (left, far, high), turn]
        else:
            turn = (STAIR_WIDTH / 2, near - 1.1, high)
            corners += [(right, far, low), (right, near, high), turn]
    return np.array(corners) + np.array([0, 0, SENSOR_HEIGHT])


PATH = _path()
