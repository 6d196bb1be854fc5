"""Whether a matrix is a rigid transformation: one check of all that is read, given and returned."""

from typing import NamedTuple

import numpy as np

TOLERANCE = 1e-4  # largest entry of R^T R - I, and of the last row's difference


class Fault(NamedTuple):
    """Why a matrix is none, a sentence, and what to do."""

    problem: str
    hint: str


def fault(T: np.ndarray) -> Fault | None:
    """The `Fault` of a matrix (4, 4) of finite numbers; None if it is rigid.

    >>> fault(np.eye(4)) is None
    True
    >>> fault(np.diag([1.0, 1.0, -1.0, 1.0])).hint
    'two axes are swapped, or one is turned round: check how the matrix is made.'
    """
    rotation, last = T[:3, :3], T[3]
    if np.abs(last - [0, 0, 0, 1]).max() > TOLERANCE:
        transposed = np.abs(T[:, 3] - [0, 0, 0, 1]).max() <= TOLERANCE
        return Fault(
            f"the last row of the matrix is {last.tolist()}, expected [0, 0, 0, 1].",
            f"{'transpose it: ' if transposed else ''}matrices are row-major, [R t; 0 1].",
        )
    if (determinant := np.linalg.det(rotation)) < 0:
        return Fault(
            f"the 3x3 part is not a rotation but a reflection (its determinant is "
            f"{determinant:.3g}).",
            "two axes are swapped, or one is turned round: check how the matrix is made.",
        )
    gram = rotation.T @ rotation
    if (error := np.abs(gram - np.eye(3)).max()) > TOLERANCE:
        scale = np.cbrt(determinant)
        scaled = scale > 0 and np.abs(gram / scale**2 - np.eye(3)).max() <= TOLERANCE
        return Fault(
            f"the 3x3 part is not a rotation (R^T R differs from the identity by {error:.2g}, at "
            f"most {TOLERANCE:g} is allowed{f'; it has the scale {scale:.6g}' if scaled else ''}).",
            "divide it by the scale, and bring the scans to the same unit."
            if scaled
            else "write more decimals; matrices are row-major, of a scanner in another frame.",
        )
    return None
