"""A pose graph for g2o: VERTEX_SE3:QUAT and EDGE_SE3:QUAT with the information matrix.

The information is of g2o's own error, [translation; vector part of the quaternion], upper triangle
row by row. `gtsam.readG2o` takes that vector part for the turn itself: use the format gtsam there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from icpshap import conventions
from icpshap.errors import UserError
from icpshap.export.format import Format, numbers, of_one_sequence
from icpshap.export.measurement import placed, quaternion

if TYPE_CHECKING:
    from icpshap.export.measurement import Measurement


class G2o(Format):
    name = "g2o"
    meaning = "a pose graph for g2o: edges EDGE_SE3:QUAT with the information matrix"

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        return {"": graph(measurements, self.name, conventions.g2o)}


def graph(
    measurements: Sequence[Measurement], name: str, converted: Callable[[np.ndarray], np.ndarray]
) -> str:
    """The text of a pose graph; converted: a covariance of ours as the reader has it.

    Raises UserError for several sequences and for a covariance that has no inverse.
    """
    of_one_sequence(measurements, name)
    poses, firsts = placed(measurements)
    lines = [
        f"VERTEX_SE3:QUAT {index} {numbers(T[:3, 3])} {numbers(quaternion(T))}"
        for index, T in poses.items()
    ]
    lines += [f"FIX {index}" for index in firsts]
    for one in measurements:
        pose = f"{numbers(one.translation)} {numbers(one.quaternion)}"
        upper = information(converted(one.covariance), one.in_words)[np.triu_indices(6)]
        lines.append(f"EDGE_SE3:QUAT {one.reference} {one.source} {pose} {numbers(upper)}")
    return "\n".join(lines) + "\n"


def information(covariance: np.ndarray, where: str) -> np.ndarray:
    """The inverse of a covariance (6, 6). Raises UserError if there is none."""
    # In units of the standard deviations, since rad and m need not be alike in size.
    scale = np.sqrt(np.diagonal(covariance))
    try:
        if not (scale > 0).all():
            raise np.linalg.LinAlgError
        root = np.linalg.cholesky(covariance / np.outer(scale, scale))
    except np.linalg.LinAlgError:
        raise UserError(
            f"{where}: the covariance is singular, and so has no information matrix: its runs do "
            "not differ in some direction.\n"
            "Hint: a start that varies more, or other formats, which hold the covariance itself."
        ) from None
    inverse = np.linalg.solve(root, np.diag(1 / scale))
    return inverse.T @ inverse
