"""Numbers of a pair of scans that show what a cause of uncertainty has done to it, without ICP.

In the pose at hand, which may be an estimate: none of them depends on it beyond the overlap
distance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap import se3
from icpshap.diagnosis.planes import planes
from icpshap.geometry import (
    information_matrix,
    information_rows,
    root_mean_square_distance,
    search_tree,
)

if TYPE_CHECKING:
    from scipy.spatial import KDTree


SAMPLE = 1200  # points of a scan at most, every k-th, at which planes are measured
FEWEST = 6  # planes that hold a pose
LEAST = 1e-4  # m, plane residual below which scans are alike: no scanner's, but simulated ones'
NUMBERS = ("plane_residual", "overlap", "reference_points", "weakest_information")
WORSE = (1, -1, -1, -1)  # the way in which each of them is worse


class Diagnostics(NamedTuple):
    """What a pair's data show.

    plane_residual [m]: median over both scans; overlap [-]: N / |P1| in the pose at hand;
    reference_points: those beyond the minimum range, of which something that hides the source takes
    none; weakest_information [-]: of the information A on the pose that the overlapping source
    points beyond the minimum range have, smallest eigenvalue over trace; direction (6,): its
    eigenvector [rotation about their centroid in units of 1 / L; translation], in the reference's
    axes; length [m]: L, their root mean square distance from their centroid.
    """

    plane_residual: float
    overlap: float
    reference_points: float
    weakest_information: float
    direction: np.ndarray
    length: float

    @property
    def are_known(self) -> bool:
        """Whether all of them could be measured."""
        return bool(np.isfinite(self.weakest_information) and self.weakest_information > 0)

    @property
    def logarithms(self) -> np.ndarray:
        """Of the `NUMBERS` (4,): causes multiply them."""
        known = self._replace(plane_residual=max(self.plane_residual, LEAST))
        return np.log([getattr(known, name) for name in NUMBERS])


class Reference(NamedTuple):
    """What of a pair its reference shows alone, which serves any source.

    tree: the search tree of its points; number: of those beyond the minimum range; residuals (k,)
    [m]: of planes, NaN where there is none.
    """

    tree: KDTree
    number: int
    residuals: np.ndarray

    @classmethod
    def of(cls, points: np.ndarray, minimum_range: float) -> Reference:
        """That of a scan (n, 3) [m] in its scanner's frame."""
        tree = search_tree(points)
        in_range = np.flatnonzero(np.linalg.norm(points, axis=1) > minimum_range)
        return cls(tree, len(in_range), planes(points, _every(in_range), tree).residuals)


def diagnostics(
    reference: Reference,
    source: np.ndarray,
    T_reference_source: np.ndarray,
    minimum_range: float,
    overlap_distance: float,
) -> Diagnostics:
    """The `Diagnostics` of a `Reference` and a source (m, 3) [m] in its scanner's frame.

    What cannot be measured, where they hardly overlap or show no planes, is NaN.
    """
    moved = se3.transform(T_reference_source, source)
    distances, _ = reference.tree.query(moved, distance_upper_bound=overlap_distance)
    overlapping = distances <= overlap_distance
    informing = np.flatnonzero(overlapping & (np.linalg.norm(source, axis=1) > minimum_range))
    rows = _every(informing)
    of_source = planes(source, rows)
    known = np.isfinite(of_source.residuals)
    overlap = float(overlapping.sum() / reference.tree.n)
    if np.count_nonzero(known) < FEWEST:
        return Diagnostics(
            np.nan, overlap, float(reference.number), np.nan, np.full(6, np.nan), np.nan
        )
    length = root_mean_square_distance(moved[informing])
    across = of_source.normals[known] @ T_reference_source[:3, :3].T
    a = information_rows(moved[rows][known], across, moved[informing].mean(axis=0), length)
    information, directions = np.linalg.eigh(information_matrix(a))
    weakest = directions[:, 0]
    return Diagnostics(
        float(np.nanmedian(np.concatenate([of_source.residuals, reference.residuals]))),
        overlap,
        float(reference.number),
        float(information[0] / information.sum()),
        # Of either sign: that with the largest component positive.
        weakest * np.sign(weakest[np.abs(weakest).argmax()]),
        length,
    )


def _every(rows):
    """At most `SAMPLE` rows, every k-th."""
    return rows[:: -(-len(rows) // SAMPLE)] if len(rows) else rows
