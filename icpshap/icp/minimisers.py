"""Error minimisers: from the kept links of one iteration to the next rigid step.

Idea: an error metric is seven features of a link (source point p where it is now, reference point
q, its normal n), and all that its minimum needs is the features' Gram matrix, the sum of their
products over the links. So the matching loop makes one kind of sum for every metric, and the step
is a little dense algebra for all runs at once. To add a metric, add a class here and its features
to `write_features`.

    point to plane   [p x n, n, q.n - p.n]      Gram = normal equations, right-hand side, error
    point to point   [p, p - q, 1]              Gram = the moments that Kabsch's method needs

Exactness: the features are those of the textbook formulas, in float64, about the centre of the
reference, where the products are small: q.n and p.n round at some 1e-16 of the distance from it,
far below any pose's accuracy. Kabsch's method gets p - q, not q, so that the sum of squares does
not cancel.

Measured: docs/engine.md.
"""

import math
from dataclasses import dataclass

import numpy as np

from icpshap.icp.compiled import jit

FEATURES = 7
SINGULAR = 1e-12  # smallest against largest eigenvalue below which a direction is unobservable
ROUNDING = 2.0**-53  # of one term of a sum, relative; a sum of n terms has rounded n times


def plane_features(x, y, z, a, b, c, d):
    """Of a link to the tangent plane a x + b y + c z = d, the row of zeros being no link."""
    distance = d - (x * a + y * b + z * c)
    return y * c - z * b, z * a - x * c, x * b - y * a, a, b, c, distance


def point_features(x, y, z, a, b, c, one):
    """Of a link to the point (a, b, c), the row of zeros being no link."""
    px, py, pz = x * one, y * one, z * one
    return px, py, pz, px - a, py - b, pz - c, one


METRICS = (plane_features, point_features)


@jit
def rotations(vectors):
    """Rotation matrices (R, 3, 3) about angle-axis vectors (R, 3) [rad]."""
    result = np.empty((len(vectors), 3, 3))
    for run in range(len(vectors)):
        x, y, z = vectors[run]
        square = x * x + y * y + z * z
        angle = math.sqrt(square)
        # Of sin(angle) / angle and (1 - cos(angle)) / angle^2, their series where these cancel.
        first = math.sin(angle) / angle if angle > 1e-3 else 1.0 - square / 6.0 + square**2 / 120.0
        half = 0.5 * angle
        ratio = math.sin(half) / half if angle > 1e-3 else 1.0 - square / 24.0 + square**2 / 1920.0
        second = 0.5 * ratio * ratio
        result[run, 0] = 1.0 - second * (y * y + z * z), second * x * y, second * x * z
        result[run, 1] = second * x * y, 1.0 - second * (x * x + z * z), second * y * z
        result[run, 2] = second * x * z, second * y * z, 1.0 - second * (x * x + y * y)
        result[run, 0, 1] -= first * z
        result[run, 1, 0] += first * z
        result[run, 0, 2] += first * y
        result[run, 2, 0] -= first * y
        result[run, 1, 2] -= first * x
        result[run, 2, 1] += first * x
    return result


@jit
def _plane_steps(gram):
    """Angle-axis vectors and translations (R, 6), and which are determined (R,)."""
    result = np.zeros((len(gram), 6))
    determined = np.empty(len(gram), np.bool_)
    scaled = np.empty((6, 6))
    scale, coefficients = np.empty(6), np.empty(6)
    for run in range(len(gram)):
        # Unit diagonal: whether it is singular must not depend on the unit of length.
        for i in range(6):
            scale[i] = math.sqrt(max(gram[run, i, i], 1e-300))
        for i in range(6):
            for j in range(6):
                scaled[i, j] = gram[run, i, j] / (scale[i] * scale[j])
        values, vectors = np.linalg.eigh(scaled)
        # Equal links round alike, sum after sum; of unit normals, the squares sum to the links.
        links = gram[run, 3, 3] + gram[run, 4, 4] + gram[run, 5, 5]
        least = max(SINGULAR, 6 * ROUNDING * links)
        determined[run] = values[0] > least * values[5]
        if not determined[run]:
            continue
        for k in range(6):
            coefficients[k] = 0.0
            for i in range(6):
                coefficients[k] += vectors[i, k] * (gram[run, i, 6] / scale[i])
            coefficients[k] /= values[k]
        for i in range(6):
            for k in range(6):
                result[run, i] += vectors[i, k] * coefficients[k]
            result[run, i] /= scale[i]
    return result, determined


@dataclass(frozen=True)
class PointToPlane:
    """Least squares of the distances to the tangent planes, linearised (Chen and Medioni, 1992).

    The step is the rotation about the angle-axis vector x[:3] and the translation x[3:] that solve
    the 6x6 normal equations.
    """

    metric = METRICS.index(plane_features)
    minimum_links = 6
    needs_normals = True

    def step(self, gram):
        """Steps (R, 4, 4) and which are determined (R,), from Gram matrices (R, 7, 7)."""
        x, determined = _plane_steps(gram)
        return _rigid(rotations(x[:, :3]), x[:, 3:]), determined

    def squared_error(self, gram):
        """Sum of squared distances to the planes (R,) [m^2]."""
        return gram[:, 6, 6]


@dataclass(frozen=True)
class PointToPoint:
    """Least squares of the distances between linked points (Kabsch, 1976)."""

    metric = METRICS.index(point_features)
    minimum_links = 3
    needs_normals = False

    def step(self, gram):
        """Steps (R, 4, 4) and which are determined (R,), from Gram matrices (R, 7, 7)."""
        count = gram[:, 6, 6, None]
        p_mean = gram[:, :3, 6] / count
        q_mean = p_mean - gram[:, 3:6, 6] / count
        sum_pq = gram[:, :3, :3] - gram[:, :3, 3:6]
        covariance = sum_pq / count[:, :, None] - p_mean[:, :, None] * q_mean[:, None, :]
        u, values, vt = np.linalg.svd(covariance)
        # Two directions fix a rotation; on a line, any turn about it fits as well. Coincident
        # points leave of the difference of two sums what both have rounded.
        squares = np.einsum("rii->r", gram[:, :6, :6])
        determined = values[:, 1] > np.maximum(SINGULAR * values[:, 0], 8 * ROUNDING * squares)
        mirrored = np.linalg.det(u) * np.linalg.det(vt) < 0
        vt[mirrored, 2] *= -1.0
        rotation = np.einsum("rij,rjk->rki", u, vt)
        translation = q_mean - np.einsum("rij,rj->ri", rotation, p_mean)
        return _rigid(rotation, translation), determined

    def squared_error(self, gram):
        """Sum of squared link lengths (R,) [m^2]."""
        return gram[:, 3, 3] + gram[:, 4, 4] + gram[:, 5, 5]


def _rigid(rotation, translation):
    T = np.zeros((len(rotation), 4, 4))
    T[:, :3, :3] = rotation
    T[:, :3, 3] = translation
    T[:, 3, 3] = 1.0
    return T
