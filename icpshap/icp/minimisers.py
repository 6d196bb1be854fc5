"""Error minimisers: from the kept links of one iteration to the next rigid step.

Idea: an error metric is seven features of a link (source point p where it is now, reference point
q, its normal n), and all that its minimum needs is the features' Gram matrix, the sum of their
products over the links. So the matching loop makes one kind of sum for every metric, and the step
is a little dense algebra for all runs at once. To add a metric, add a class here and the function
of its features to METRICS: plain arithmetic with a point (x, y, z) and a row of
`Reference.surface`, and linear in that row, so that a row of zeros, which stands for no link, adds
nothing.

    point to plane   [p x n, n, q.n - p.n]      Gram = normal equations, right-hand side, error
    point to point   [p, p - q, 1]              Gram = the moments that Kabsch's method needs

Exactness: the features are those of the textbook formulas, in float64, about the centre of the
reference, where the products are small: q.n and p.n round at some 1e-16 of the distance from it,
far below any pose's accuracy. Kabsch's method gets p - q, not q, so that the sum of squares does
not cancel.

Measured: docs/engine.md.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

FEATURES = 7
SINGULAR = 1e-12  # smallest against largest eigenvalue below which a direction is unobservable
ROUNDING = 2.0**-53  # of one term of a sum, relative; a sum of n terms has rounded n times


def plane_features(
    x: float, y: float, z: float, a: float, b: float, c: float, d: float
) -> tuple[float, ...]:
    """Of a link to the tangent plane a x + b y + c z = d."""
    distance = d - (x * a + y * b + z * c)
    return y * c - z * b, z * a - x * c, x * b - y * a, a, b, c, distance


def point_features(
    x: float, y: float, z: float, a: float, b: float, c: float, one: float
) -> tuple[float, ...]:
    """Of a link to the point (a, b, c)."""
    px, py, pz = x * one, y * one, z * one
    return px, py, pz, px - a, py - b, pz - c, one


METRICS: tuple[Callable[..., tuple], ...] = (plane_features, point_features)


@dataclass(frozen=True)
class PointToPlane:
    """Least squares of the distances to the tangent planes, linearised (Chen and Medioni, 1992).

    The step is the rotation about the angle-axis vector x[:3] and the translation x[3:] that solve
    the 6x6 normal equations.
    """

    metric = METRICS.index(plane_features)
    minimum_links = 6
    needs_normals = True

    def step(self, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps (R, 4, 4) and which are determined (R,), from Gram matrices (R, 7, 7)."""
        normal_matrix, right = gram[:, :6, :6], gram[:, :6, 6]
        # Unit diagonal: whether it is singular must not depend on the unit of length.
        scale = np.sqrt(np.maximum(np.diagonal(normal_matrix, axis1=1, axis2=2), 1e-300))
        values, vectors = np.linalg.eigh(normal_matrix / (scale[:, :, None] * scale[:, None, :]))
        # Equal links round alike, sum after sum; of unit normals, the squares sum to the links.
        links = gram[:, 3, 3] + gram[:, 4, 4] + gram[:, 5, 5]
        rounding = 6 * ROUNDING * links
        determined = values[:, 0] > np.maximum(SINGULAR, rounding) * values[:, -1]
        values[~determined] = 1.0
        coefficients = np.einsum("rij,ri->rj", vectors, right / scale) / values
        x = np.einsum("rij,rj->ri", vectors, coefficients) / scale
        x[~determined] = 0.0
        return _rigid(Rotation.from_rotvec(x[:, :3]).as_matrix(), x[:, 3:]), determined

    def squared_error(self, gram: np.ndarray) -> np.ndarray:
        """Sum of squared distances to the planes (R,) [m^2]."""
        return gram[:, 6, 6]


@dataclass(frozen=True)
class PointToPoint:
    """Least squares of the distances between linked points (Kabsch, 1976)."""

    metric = METRICS.index(point_features)
    minimum_links = 3
    needs_normals = False

    def step(self, gram: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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

    def squared_error(self, gram: np.ndarray) -> np.ndarray:
        """Sum of squared link lengths (R,) [m^2]."""
        return gram[:, 3, 3] + gram[:, 4, 4] + gram[:, 5, 5]


def _rigid(rotation, translation):
    T = np.zeros((len(rotation), 4, 4))
    T[:, :3, :3] = rotation
    T[:, :3, 3] = translation
    T[:, 3, 3] = 1.0
    return T
