"""Rigid transformations SE(3), exponential coordinates xi = [rotation (rad); translation (m)].

Every function works on any number of leading dimensions. A matrix named ``T_target_source`` maps
source coordinates into the target frame: ``p_target = T_target_source @ p_source``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import RigidTransform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


def exp(xi: ArrayLike) -> np.ndarray:
    """Exact exponential map, se(3) to SE(3): (..., 6) to (..., 4, 4).

    >>> quarter_turn = exp(np.array([0, 0, np.pi / 2, 0, 0, 0]))
    >>> (quarter_turn @ [1, 0, 0, 1]).round(3).tolist()
    [0.0, 1.0, 0.0, 1.0]
    """
    xi = np.asarray(xi, dtype=float)
    matrices = RigidTransform.from_exp_coords(xi.reshape(-1, 6)).as_matrix()
    return matrices.reshape(*xi.shape[:-1], 4, 4)


def log(T: ArrayLike) -> np.ndarray:
    """Inverse of `exp` for rotation angles up to pi: (..., 4, 4) to (..., 6).

    Raises ValueError if a matrix is not a rigid transformation (determinant not positive, or last
    row not [0, 0, 0, 1]).

    >>> T = np.eye(4)
    >>> T[:3, 3] = [1, 2, 3]
    >>> log(T).tolist()
    [0.0, 0.0, 0.0, 1.0, 2.0, 3.0]
    """
    T = np.asarray(T, dtype=float)
    coordinates = RigidTransform.from_matrix(T.reshape(-1, 4, 4)).as_exp_coords()
    return coordinates.reshape(*T.shape[:-2], 6)


def inverse(T: ArrayLike) -> np.ndarray:
    """Inverse of a rigid transformation, (..., 4, 4), by transposing its rotation.

    >>> T = exp(np.array([0.1, 0.2, 0.3, 1, 2, 3]))
    >>> bool(np.allclose(inverse(T) @ T, np.eye(4)))
    True
    """
    T = np.asarray(T, dtype=float)
    result = np.zeros_like(T)
    rotation = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -(rotation @ T[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def transform(T_target_source: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Apply one transformation (4, 4) to points (n, 3).

    >>> T = np.eye(4)
    >>> T[:3, 3] = [1, 2, 3]
    >>> transform(T, np.zeros((2, 3))).tolist()
    [[1.0, 2.0, 3.0], [1.0, 2.0, 3.0]]
    """
    return points @ T_target_source[:3, :3].T + T_target_source[:3, 3]


def hat(vector: ArrayLike) -> np.ndarray:
    """Cross-product matrix: hat(a) @ b = a x b; (..., 3) to (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*vector.shape[:-1], 3, 3)


def adjoint(T: ArrayLike) -> np.ndarray:
    """Adjoint (..., 6, 6): T exp(xi) inv(T) = exp(adjoint(T) xi), rotation first.

    >>> T, xi = exp(np.array([0.1, 0.2, 0.3, 1, 2, 3])), np.array([0.1, 0, 0, 0, 0.2, 0])
    >>> bool(np.allclose(T @ exp(xi) @ inverse(T), exp(adjoint(T) @ xi)))
    True
    """
    T = np.asarray(T, dtype=float)
    rotation = T[..., :3, :3]
    result = np.zeros((*T.shape[:-2], 6, 6))
    result[..., :3, :3] = rotation
    result[..., 3:, 3:] = rotation
    result[..., 3:, :3] = hat(T[..., :3, 3]) @ rotation
    return result
