"""Rolling ground with nine trees and six rocks."""

from types import ModuleType

import numpy as np

from icpshap.data.scenes._parts import SENSOR_HEIGHT, cylinder, sphere

SIZE = 90.0  # m
TREES = [(-6, 5), (-2, -7), (4, 9), (9, -4), (14, 6), (19, -9), (22, 3), (-13, -3), (30, 12)]
ROCKS = [(-4, -2.5), (2, 4), (7, -7), (12, 2.5), (16, -3), (24, -6)]


def _ground_height(x, y):
    """Height [m] of the plain: gentle waves and a slope that rises at its edge."""
    waves = 0.5 * np.sin(0.21 * x + 0.3) * np.cos(0.17 * y) + 0.12 * np.sin(0.9 * x + 0.7 * y)
    edge = np.maximum(np.hypot(x - 6, y) - 14, 0)
    return waves + 0.02 * edge**1.6


def build(open3d: ModuleType) -> list:
    """The meshes."""
    ticks = np.arange(-SIZE / 2, SIZE / 2 + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (
        part.ravel()
        for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:])
    )
    ground = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.stack([x, y, _ground_height(x, y)], -1).reshape(-1, 3)),
        open3d.utility.Vector3iVector(
            np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
        ),
    )
    meshes = [ground]
    for index, (x, y) in enumerate(TREES):
        base = (x, y, _ground_height(x, y) - 0.2)
        trunk = 2.0 + 0.3 * (index % 4)
        meshes.append(cylinder(open3d, base, 0.15 + 0.03 * (index % 3), trunk))
        meshes.append(sphere(open3d, np.add(base, (0, 0, trunk + 1.0)), 1.3 + 0.2 * (index % 3)))
    for index, (x, y) in enumerate(ROCKS):
        meshes.append(sphere(open3d, (x, y, _ground_height(x, y)), 0.35 + 0.15 * (index % 3)))
    return meshes


def _on_the_ground(corners):
    x, y = np.array(corners, dtype=float).T
    return np.stack([x, y, _ground_height(x, y) + SENSOR_HEIGHT], axis=-1)


PATH = _on_the_ground([(-5, 1), (-2, 0), (1, 1), (4, 2), (7, 1), (10, -1), (14, 0), (18, 1)])
