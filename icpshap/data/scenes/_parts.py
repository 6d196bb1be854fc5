"""What scenes share: triangle meshes, made with the imported module open3d, and a height."""

import numpy as np

SENSOR_HEIGHT = 1.0  # m above the ground


def box(open3d, low, high):
    low, size = np.array(low, dtype=float), np.subtract(high, low)
    return open3d.geometry.TriangleMesh.create_box(*size).translate(low)


def cylinder(open3d, base, radius, height):
    mesh = open3d.geometry.TriangleMesh.create_cylinder(radius, height, resolution=16, split=1)
    return mesh.translate(np.add(base, (0, 0, height / 2)))


def sphere(open3d, centre, radius):
    return open3d.geometry.TriangleMesh.create_sphere(radius, resolution=12).translate(centre)


def wall(open3d, start, end, height, openings=()):
    """Wall along x or y; ``openings``: (from, to, bottom, top) along it, in metres of that axis."""
    axis = int(start[0] == end[0])

    def piece(low, high, bottom, top):
        lows, highs = np.array([*start, bottom]), np.array([*start, top])
        lows[axis], highs[axis] = low, high
        lows[1 - axis] -= 0.05
        highs[1 - axis] += 0.05
        return box(open3d, lows, highs)

    pieces, position = [], start[axis]
    for low, high, bottom, top in openings:
        pieces.append(piece(position, low, 0.0, height))
        pieces.append(piece(low, high, top, height))
        if bottom > 0:
            pieces.append(piece(low, high, 0.0, bottom))
        position = high
    return [*pieces, piece(position, end[axis], 0.0, height)]
