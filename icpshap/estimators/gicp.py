"""The inverse Hessian of generalised ICP, as fast_gicp and small_gicp give it to their users.

Segal, Haehnel, Thrun, "Generalized-ICP" (RSS 2009): plane to plane, by Gauss-Newton.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from icpshap import se3
from icpshap.estimators import perturb
from icpshap.estimators.closed_form import FEWEST_LINKS, is_singular
from icpshap.estimators.kind import (
    COVARIANCES,
    GOOD_STATUS,
    UNSHARED,
    Covariance,
    Kind,
    of_definite,
)
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap import icp
    from icpshap.estimators.perturb import Group


DAMPING = 1e-6  # is added to the diagonal of H before a step, as in small_gicp


@dataclass(frozen=True)
class Gicp(Kind):
    """H^-1 where generalised ICP comes to rest, from the true pose and with the first run's rows.

    Its unit of noise is 1 m^2 in the plane of a point, whatever the sensor.
    """

    name: ClassVar = "gicp"
    returns: ClassVar = COVARIANCES
    sees: ClassVar = UNSHARED

    neighbours: int = option(
        20,
        "Neighbours of a point, itself included, that give the plane it lies on",
        unit="-",
        minimum=3,
        maximum=50,
    )
    maximum_distance: float = option(
        1.0, "Longer links are not made", unit="m", above=0, maximum=1e6
    )
    scale: str = option(
        "none",
        "none: the inverse of H; residuals: that times the variance which the weighted residuals "
        "suggest",
        choices=("none", "residuals"),
    )
    maximum_iterations: int = option(
        100,
        "It stops at the latest after this many iterations; noisy clouds may oscillate by less "
        "than a millimetre until then",
        unit="-",
        minimum=1,
        maximum=10000,
    )
    stop_rotation: float = option(
        1e-6,
        "It stops when a step is below this and below stop_translation",
        unit="rad",
        minimum=0,
        maximum=10,
    )
    stop_translation: float = option(
        1e-6,
        "It stops when a step is below this and below stop_rotation",
        unit="m",
        minimum=0,
        maximum=1e6,
    )

    def spread(self, noise_draws: int) -> str:
        scale = "a noise of 1 m in the plane of each point"
        if self.scale == "residuals":
            scale = "the noise that the weighted residuals suggest"
        return (
            f"The covariance is the inverse Hessian of generalised ICP, for {scale}; it was told "
            "no noise of the sensor."
        )

    @property
    def made_of(self) -> str:
        scaled = " times the variance of the residuals" * (self.scale == "residuals")
        return f"inverse Hessian of generalised ICP{scaled}"

    @property
    def neighbourhood(self) -> tuple[int, float]:
        return self.neighbours, 0.0

    def estimate(self, group: Group) -> Iterator[Covariance]:
        reference = Planar.of(group.reference, self.neighbours)
        for same in perturb.alike(group.starts):
            points = same[0].source[same[0].rows[0]]
            found = self._of(reference, points, group.pair.T_reference_source)
            for start in same:
                yield Covariance(start.setting, group.noise_draw, *found)

    def _of(self, reference, points, T):
        """The fields of a `Covariance` after the noise draw, of source points (m, 3)."""
        nan = np.full((6, 6), np.nan)
        if len(points) < max(self.neighbours, FEWEST_LINKS):
            return T, nan, 0, "too_few_links", np.nan, 0.0
        source = Planar.of(points, self.neighbours)
        end = register(
            reference,
            source,
            T,
            self.maximum_distance,
            self.maximum_iterations,
            (self.stop_rotation, self.stop_translation),
        )
        at = end.linearised
        inlier_ratio = at.links / len(points)
        covariance, status = nan, end.status
        if status in GOOD_STATUS:
            covariance = np.linalg.inv(at.matrix)
            if self.scale == "residuals":
                covariance = at.weighted / (3 * at.links - 6) * covariance
            status = of_definite(status, covariance)
        rmse = np.sqrt(at.squared / at.links) if at.links else np.nan
        return end.T_reference_source, covariance, end.iterations, status, rmse, inlier_ratio


# --- the mathematics ------------------------------------------------------------------------------


class Planar(NamedTuple):
    """Points (n, 3) [m], the unit normals of their planes (n, 3), an icp.Matcher to the points."""

    points: np.ndarray
    normals: np.ndarray
    matcher: icp.Matcher

    @classmethod
    def of(cls, points: np.ndarray, neighbours: int) -> Planar:
        """That of points (n, 3) [m], which get a spatial order.

        neighbours: of a point that give its normal, the point itself included.
        """
        from icpshap import icp
        from icpshap.icp import kdtree

        # What neighbours are linked to are neighbours, which lie in the cache then.
        points = points[kdtree.build(points).rows]
        reference = icp.Reference(points, neighbours)
        return cls(points, reference.in_rows(reference.normals), icp.Matcher(reference))


class LinearisedLinks(NamedTuple):
    """Sums over links: H (6, 6), its gradient (6,), weighted and plain squares [m^2], number."""

    matrix: np.ndarray
    gradient: np.ndarray
    weighted: float
    squared: float
    links: int


class End(NamedTuple):
    """Where a registration ended: pose, steps taken, status, and the links at that pose."""

    T_reference_source: np.ndarray
    iterations: int
    status: str
    linearised: LinearisedLinks


def linearise(
    reference: Planar, source: Planar, T: np.ndarray, maximum_distance: float
) -> LinearisedLinks:
    """`LinearisedLinks` at the pose T (4, 4): each source point to its nearest reference point."""
    from icpshap.icp import plane_to_plane

    _, rows = reference.matcher(se3.transform(T, source.points), maximum_distance**2)
    sums = plane_to_plane.linearise(source[:2], reference[:2], rows[:, 0], T)
    return LinearisedLinks(*sums)


def register(
    reference: Planar,
    source: Planar,
    T: np.ndarray,
    maximum_distance: float,
    maximum_iterations: int,
    stop: tuple[float, float],
) -> End:
    """Generalised ICP of two `Planar` clouds from the pose T (4, 4); see `End`.

    stop: a step below both [rad, m] is the last.
    """
    status = "max_iterations"
    for iteration in range(1, maximum_iterations + 1):
        at = linearise(reference, source, T, maximum_distance)
        if failure := _failure(at):
            return End(T, iteration - 1, failure, at)
        step = np.linalg.solve(at.matrix + DAMPING * np.eye(6), at.gradient)
        T = T @ se3.exp(step)
        if np.linalg.norm(step[:3]) < stop[0] and np.linalg.norm(step[3:]) < stop[1]:
            status = "ok"
            break
    at = linearise(reference, source, T, maximum_distance)
    return End(T, iteration, _failure(at) or status, at)


def _failure(linearised):
    """The status of links that determine no pose, or ""."""
    if linearised.links < FEWEST_LINKS:
        return "too_few_links"
    return "degenerate" if is_singular(linearised.matrix, linearised.links) else ""
