"""Few surfaces that hold one direction of the pose (paper, "Under-constrained situations")."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap import se3
from icpshap.causes.cause import Cause
from icpshap.errors import PerturbationError
from icpshap.geometry import (
    information_matrix,
    information_rows,
    normals,
    root_mean_square_distance,
)
from icpshap.options import Range

if TYPE_CHECKING:
    from icpshap.causes._given import RawPair, Streams


NEIGHBOURS = 10  # of a normal, the point itself included


@dataclass(frozen=True)
class UnderConstrained(Cause):
    """Points that hold the weakest direction go until the share u of its information is gone.

    A link of point to plane ICP between a point p with the normal n tells of the pose's error
    a = [(p - c) x n / L; n], so the information is A = sum a a^T, over the overlapping source
    points beyond the chain's minimum range, at the true pose and in the reference's frame; c is
    their centroid, L their root mean square distance from it. v is the eigenvector of A's smallest
    eigenvalue. Points go in the order of falling (a.v)^2: of the source those that A is made of, of
    the reference all beyond the minimum range. With information (1 - u) in one direction and no
    covariance floor f = (-ln(1 - u) - u) / 2.
    """

    name: ClassVar = "under_constrained"
    title: ClassVar = "under-constrained situation"
    symbol: ClassVar = "u"
    meaning: ClassVar = (
        "Share u of the information on the weakest direction of the pose that is taken away, "
        "below 1"
    )
    range: ClassVar = Range(minimum=0, below=1)
    colour: ClassVar = "#CC79A7"
    levels: ClassVar = (0.5, 0.9, 0.99)
    mitigation: ClassVar = "structure, or another sensor, along the weak direction"
    order: ClassVar = 40
    counts_points: ClassVar = True
    shown_by: ClassVar = "weakest_information"

    @property
    def drawn(self) -> tuple[()]:
        """Nothing is: it is the same in every run."""
        return ()

    def check(self, pair: RawPair, level: float) -> None:
        if not pair.overlap_in_range.any():
            raise PerturbationError(
                "under_constrained: no overlapping source point is farther from the scanner than "
                f"minimum_range: {pair.minimum_range:g} m, expected some.\n"
                "Hint: a smaller minimum_range, or leave out under_constrained."
            )

    def keep(
        self, pair: RawPair, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        kept = np.ones(len(getattr(pair, scan)), dtype=bool)
        order, gone = _removal(pair)[scan]
        kept[order[: np.searchsorted(gone, level * gone[-1])]] = False
        return kept


@lru_cache(maxsize=1)
def _removal(pair):
    """Of each scan, rows in the order in which a growing u takes them, and what is gone by then.

    The information (k + 1,) on the weakest direction that has gone before each row, and in the end.
    """
    informing = np.flatnonzero(pair.overlap_in_range)
    T = pair.T_reference_source
    source = se3.transform(T, pair.source)
    centre = source[informing].mean(axis=0)
    length = root_mean_square_distance(source[informing])

    def information(points, raw, rotation, rows):
        across = normals(raw, NEIGHBOURS, rows) @ rotation.T
        return information_rows(points[rows], across, centre, length)

    of_source = information(source, pair.source, T[:3, :3], informing)
    _, vectors = np.linalg.eigh(information_matrix(of_source))
    weakest = vectors[:, 0]
    ranges = np.linalg.norm(pair.reference, axis=1)
    in_range = np.flatnonzero(ranges > pair.minimum_range)
    of_reference = information(pair.reference, pair.reference, np.eye(3), in_range)
    return {
        "source": _in_order(informing, of_source, weakest),
        "reference": _in_order(in_range, of_reference, weakest),
    }


def _in_order(rows, information, direction):
    along = np.einsum("ni,i->n", information, direction) ** 2
    order = np.argsort(-along, kind="stable")
    return rows[order], np.concatenate([[0.0], np.cumsum(along[order])])
