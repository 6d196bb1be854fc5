"""A trajectory in TUM's format, and in a second file how sure its poses are.

TUM's format has eight numbers a line and no place for more. Poses and covariances are those of a
chain of registrations, compounded from its first scan: errors of different pairs count as
independent of one another, as those of our runs are.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from icpshap import se3
from icpshap.errors import UserError
from icpshap.export.format import Format, numbers, of_one_sequence
from icpshap.export.measurement import quaternion

if TYPE_CHECKING:
    from icpshap.export.measurement import Measurement


class Tum(Format):
    name = "tum"
    meaning = "a trajectory in TUM's format, and a second file with the covariance of each pose"

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        of_one_sequence(measurements, self.name)
        poses, spreads = ["# scan tx ty tz qx qy qz qw"], [_HEAD]
        for index, T, covariance in compounded(measurements):
            poses.append(f"{index} {numbers(T[:3, 3])} {numbers(quaternion(T))}")
            spreads.append(f"{index} {numbers(covariance[np.triu_indices(6)])}")
        return {"": "\n".join(poses) + "\n", "_covariances": "\n".join(spreads) + "\n"}


_HEAD = (
    "# scan, and the upper triangle, row by row, of the covariance of xi in T_first_scan exp(xi): "
    "rotation first [rad, m], in the frame of the scan"
)


def compounded(measurements: Sequence[Measurement]) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Index, T_first_scan (4, 4) and its covariance (6, 6) [rad, m] of each scan of a chain.

    The first order of the compounded error: xi of one scan, carried to the next, and what the next
    registration adds. Raises UserError if the pairs are no chain.
    """
    index, T, covariance = measurements[0].reference, np.eye(4), np.zeros((6, 6))
    found = [(index, T, covariance)]
    for one in measurements:
        if one.reference != index:
            raise UserError(
                f"tum: the pair {one.in_words} does not go on from scan {index}, expected a chain "
                "of pairs, each from the source of the one before.\n"
                "Hint: other formats take any pairs, also where one without a covariance is left "
                "out."
            )
        carry = se3.adjoint(se3.inverse(one.T_reference_source))
        covariance = carry @ covariance @ carry.T + one.covariance
        index, T = one.source, T @ one.T_reference_source
        found.append((index, T, covariance))
    return found
