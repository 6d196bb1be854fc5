"""Normals: the direction in which a point's nearest neighbours vary least.

Idea: the eigenvector of the smallest eigenvalue of the neighbours' scatter matrix. Points are
visited in tree order: the neighbour distances of one bound the search of the next. Neighbours are
a number of the nearest, and all others within a radius.

Exactness: the neighbours are those of the k-d tree; the eigenvector comes by Jacobi rotations,
which are accurate to the last bits for matrices this small. The sign is arbitrary and does not
matter to point-to-plane ICP.

Measured: docs/engine.md.
"""

import math

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.compiled import Array, jit


@jit
def _smallest_eigenvector(matrix, vectors):
    """Diagonalise the symmetric 3x3 `matrix` in place; returns the column of `vectors` to take."""
    for row in range(3):
        for column in range(3):
            vectors[row, column] = 1.0 if row == column else 0.0
    for _ in range(12):
        off_diagonal = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if off_diagonal <= 1e-17 * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0.0:
                    continue
                theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(theta * theta + 1.0))
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                r = 3 - p - q
                shift = t * matrix[p, q]
                matrix[p, p] -= shift
                matrix[q, q] += shift
                matrix[p, q] = matrix[q, p] = 0.0
                a, b = matrix[r, p], matrix[r, q]
                matrix[r, p] = matrix[p, r] = c * a - s * b
                matrix[r, q] = matrix[q, r] = s * a + c * b
                for row in range(3):
                    a, b = vectors[row, p], vectors[row, q]
                    vectors[row, p] = c * a - s * b
                    vectors[row, q] = s * a + c * b
    smallest = 0
    for axis in range(1, 3):
        if matrix[axis, axis] < matrix[smallest, smallest]:
            smallest = axis
    return smallest


@jit
def planes(tree: kdtree.Tree, neighbours: int, radius: float) -> Array:
    """Tangent planes in tree order: unit normal, and its product with the point [m].

    (n + 1, 4); the last row is zero, for links to nothing. From that many neighbours, the point
    itself included, or from all within the radius [m] if these are more.
    """
    points = tree.points
    n = points.shape[0]
    result = np.zeros((n + 1, 4))
    found = np.empty(max(neighbours, n if radius > 0.0 else 0), np.int32)
    distance = np.empty(neighbours)
    stack = np.empty(kdtree.STACK, np.int32)
    scatter, vectors = np.empty((3, 3)), np.empty((3, 3))
    mean, difference = np.empty(3), np.empty(3)
    bound = np.inf
    for k in range(n):
        point = points[k]
        x, y, z = point[0], point[1], point[2]
        if k > 0:
            step = 0.0
            for axis in range(3):
                step += (point[axis] - points[k - 1, axis]) ** 2
            bound = (math.sqrt(distance[neighbours - 1]) + math.sqrt(step)) * (1 + 1e-9) + 1e-12
        kdtree.nearest(tree, x, y, z, bound * bound, found, distance, stack)
        number = neighbours
        if radius > 0.0 and distance[neighbours - 1] <= radius * radius:
            number = kdtree.within(tree, x, y, z, radius, n, found, stack)
        for axis in range(3):
            mean[axis] = 0.0
            for t in range(number):
                mean[axis] += points[found[t], axis] - point[axis]
            mean[axis] /= number
        scatter[:] = 0.0
        for t in range(number):
            for axis in range(3):
                difference[axis] = points[found[t], axis] - point[axis] - mean[axis]
            for row in range(3):
                for column in range(3):
                    scatter[row, column] += difference[row] * difference[column]
        column = _smallest_eigenvector(scatter, vectors)
        for axis in range(3):
            result[k, axis] = vectors[axis, column]
            result[k, 3] += vectors[axis, column] * point[axis]
    return result
