"""Rigid transformations SE(3), exponential coordinates xi = [rotation (rad); translation (m)].

Every function works on any number of leading dimensions. A matrix named ``T_target_source`` maps
source coordinates into the target frame: ``p_target = T_target_source @ p_source``.
"""

import numpy as np
from scipy.spatial.transform import RigidTransform


def exp(xi: np.ndarray) -> np.ndarray:
    """Exact exponential map, se(3) to SE(3): (..., 6) to (..., 4, 4)."""
    xi = np.asarray(xi, dtype=float)
    matrices = RigidTransform.from_exp_coords(xi.reshape(-1, 6)).as_matrix()
    return matrices.reshape(*xi.shape[:-1], 4, 4)


def log(T: np.ndarray) -> np.ndarray:
    """Inverse of `exp` for rotation angles up to pi: (..., 4, 4) to (..., 6).

    Raises ValueError if a matrix is not a rigid transformation (determinant not positive, or last
    row not [0, 0, 0, 1]).
    """
    T = np.asarray(T, dtype=float)
    coordinates = RigidTransform.from_matrix(T.reshape(-1, 4, 4)).as_exp_coords()
    return coordinates.reshape(*T.shape[:-2], 6)


def inverse(T: np.ndarray) -> np.ndarray:
    """Inverse of a rigid transformation, (..., 4, 4), by transposing its rotation."""
    T = np.asarray(T, dtype=float)
    result = np.zeros_like(T)
    rotation = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3] = rotation
    result[..., :3, 3] = -(rotation @ T[..., :3, 3, None])[..., 0]
    result[..., 3, 3] = 1.0
    return result


def transform(T_target_source: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Apply one transformation (4, 4) to points (n, 3)."""
    return points @ T_target_source[:3, :3].T + T_target_source[:3, 3]


def hat(vector: np.ndarray) -> np.ndarray:
    """Cross-product matrix: hat(a) @ b = a x b; (..., 3) to (..., 3, 3)."""
    vector = np.asarray(vector, dtype=float)
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*vector.shape[:-1], 3, 3)


def adjoint(T: np.ndarray) -> np.ndarray:
    """Adjoint (..., 6, 6): T exp(xi) inv(T) = exp(adjoint(T) xi), rotation first."""
    T = np.asarray(T, dtype=float)
    rotation = T[..., :3, :3]
    result = np.zeros((*T.shape[:-2], 6, 6))
    result[..., :3, :3] = rotation
    result[..., 3:, 3:] = rotation
    result[..., 3:, :3] = hat(T[..., :3, 3]) @ rotation
    return result
