"""The covariance of ICP in closed form: the noise of the points, through the solution's gradient.

Censi, "An accurate closed-form estimate of ICP's covariance" (ICRA 2007), for matches, normals and
weights that are held. The pose T exp(xi) minimises the sum of squared residuals e_l = W_l (p - q),
where W_l = n n^T for planes and the identity for points. Everything is expressed in the frame of
the source, in which a source point s moves by B xi, B = [-[s]x, I], so that the result is the
covariance of xi, rotation first:

    H = sum_l B^T W_l B,   C = H^-1 [ sum_i s_i^2 G_i G_i^T + sum_j s_j^2 G_j G_j^T ] H^-1,

G_i = sum of B^T W_l over the links of source point i, G_j over those of reference point j, s^2 the
variance of a point's noise on each coordinate. Censi's terms with the residuals themselves change f
by 0.007 at most on the real pair: they are left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from icpshap import se3
from icpshap.estimators import perturb
from icpshap.estimators._chain import ChainKind
from icpshap.estimators.kind import (
    COVARIANCES,
    GOOD_STATUS,
    UNSHARED,
    Covariance,
    of_definite,
    told,
)
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap import icp
    from icpshap.estimators.kind import Returns
    from icpshap.estimators.perturb import Group, Start


FEWEST_LINKS = 7
SINGULAR = 1e-12  # smallest against largest eigenvalue below which a direction is unobservable
ROUNDING = 2.0**-53  # of one term of a sum, relative; a sum of n terms has rounded n times


@dataclass(frozen=True)
class ClosedForm(ChainKind):
    """The closed form where the chain comes to rest, from the true pose and the first run's rows.

    With `metric: point_to_point` it is wrong in principle, and there to be compared: points on a
    surface find other matches when it slides along itself, so that held matches make it look
    certain of what it cannot see (Bonnabel, Barczyk, Goulette, "On the covariance of ICP-based
    scan-matching techniques", ACC 2016).
    """

    name: ClassVar = "closed_form"
    returns: ClassVar = COVARIANCES
    sees: ClassVar = UNSHARED

    links: str = option(
        "shared",
        "shared: noise belongs to points, and the links of one share it (exact for held matches); "
        "independent: each link has noise of its own (libpointmatcher), with 3 matches 2 to 4 "
        "times too small a standard deviation",
        choices=("shared", "independent"),
    )
    noise: str = option(
        "known",
        "Noise that the closed form is told. known: sensor_sigma and the setting's sensor noise, "
        "in squares; fixed: sensor_sigma in every setting; residuals: estimated from those of the "
        "kept links, which trimming makes too small",
        choices=("known", "fixed", "residuals"),
    )
    sensor_sigma: float = option(
        0.01,
        "Standard deviation of the sensor's own noise on each coordinate of both clouds; never 0: "
        "the clean covariance would be 0, and the KL divergence from it infinite",
        unit="m",
        above=0,
        maximum=100,
    )

    def returned(self, noise_draws: int) -> Returns:
        return replace(
            self.returns,
            sensor_sigma=0.0 if self.noise == "residuals" else self.sensor_sigma,
            together=self.noise == "known",
        )

    def spread(self, noise_draws: int) -> str:
        metric = "tangent planes" if self.metric == "point_to_plane" else "points"
        links = "shared by the links of a point" if self.links == "shared" else "of each link"
        text = (
            f"The covariance is what white noise of the points ({links}) does to the minimum over "
            f"{metric}, in closed form with matches and normals held (Censi), {self._told}"
        )
        if self.metric == "point_to_point":
            text += "; for points that is wrong in principle, and here to be compared"
        return f"{text}."

    @property
    def _told(self):
        """What noise it was told, in words."""
        if self.noise == "residuals":
            return "as large as the residuals of the kept links, which trimming makes too small"
        also = " and the sensor noise of the setting" * (self.noise == "known")
        return f"told {told(self.sensor_sigma)} for the sensor's own{also}"

    @property
    def made_of(self) -> str:
        return f"closed form, {self.metric.replace('_', ' ')}, {self.links} links"

    def estimate(self, group: Group) -> Iterator[Covariance]:
        reference = self.reference(group.reference)
        for same in perturb.alike(group.starts):
            run = self.from_truth(group, reference, same[0])
            T = run.T_reference_source[0]
            found = self.at(group, reference, same[0], T, run.status[0])
            yield from found.estimates(group, same, T, run.iterations[0])

    def at(
        self, group: Group, reference: icp.Reference, start: Start, T: np.ndarray, status: str
    ) -> Linearised:
        """The `Linearised` of a start's first rows at the pose T (4, 4) that a run ended at.

        status: of that run; one that failed is not linearised.
        """
        if status not in GOOD_STATUS:
            return failed(status)
        points = start.source[start.rows[0]]
        of_source, of_reference = self.variances(group, start)
        found = of_clouds(reference, points, T, self.chain(), of_source, of_reference, self.links)
        return found._replace(status=status) if found.status == "ok" else found

    def variances(
        self, group: Group, start: Start
    ) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
        """What `of_clouds` is told of a start's first rows (k,) and of the reference (n,) [m^2]."""
        if self.noise == "residuals":
            return None, None
        own, counts = self.sensor_sigma**2, self.noise == "known"
        return (
            own + counts * start.source_variance[start.rows[0]],
            own + counts * group.reference_variance,
        )


# --- the mathematics ------------------------------------------------------------------------------


class Links(NamedTuple):
    """The links that a chain keeps at a pose: of m source points, k each, to n reference points.

    points (m, 3) [m], normals (n, 3) of the reference or, without planes, None: both in the source
    frame; a normal looks to the scanner of the reference. reference (m, k): rows; kept (m, k);
    squared_error [m^2]: sum of the squared residuals of the kept links.
    """

    points: np.ndarray
    normals: np.ndarray | None
    reference: np.ndarray
    kept: np.ndarray
    squared_error: float

    @property
    def number(self) -> int:
        """Number of kept links."""
        return int(np.count_nonzero(self.kept))


class Linearised(NamedTuple):
    """What the closed form says at a pose, of xi in T exp(xi), rotation first.

    covariance (6, 6) [rad, m]: NaN where status is not ok, but too_few_links or degenerate;
    bias (6, 6): that of an error along the normals which all points of a cloud share, with the mean
    variance of the noise of each cloud (Brossard), NaN without planes; links: kept ones; rmse [m];
    inlier_ratio: share of the links that were kept.
    """

    covariance: np.ndarray
    status: str
    bias: np.ndarray
    links: int
    rmse: float
    inlier_ratio: float

    def estimates(
        self, group: Group, starts: Iterable[Start], T: np.ndarray, iterations: int
    ) -> list[Covariance]:
        """A `Covariance` of each of the starts, of a run that took so many steps to T (4, 4)."""
        fields = T, self.covariance, iterations, self.status, self.rmse, self.inlier_ratio
        return [Covariance(start.setting, group.noise_draw, *fields) for start in starts]


def failed(
    status: str, links: int = 0, rmse: float = np.nan, inlier_ratio: float = 0.0
) -> Linearised:
    """The `Linearised` of a pose at which there is no covariance."""
    nan = np.full((6, 6), np.nan)
    return Linearised(nan, status, nan, links, rmse, inlier_ratio)


def of_clouds(
    reference: icp.Reference,
    points: np.ndarray,
    T: np.ndarray,
    chain: icp.Chain,
    source_variance: np.ndarray | None = None,
    reference_variance: np.ndarray | None = None,
    links: str = "shared",
) -> Linearised:
    """The `Linearised` of source points (m, 3) [m] at the pose T (4, 4) on an icp.Reference.

    chain: icp.Chain, which makes and keeps the links; source_variance (m,), reference_variance
    (n,) [m^2]: of the noise on each coordinate, or None to estimate one variance for both clouds
    from the residuals; links: shared or independent (see the option). Fewer than 7 kept links are
    too_few_links, an H that is singular is degenerate.
    """
    if len(points) == 0:
        return failed("too_few_links")
    found = kept_links(reference, points, T, chain)
    number, inlier_ratio = found.number, found.number / found.kept.size
    rmse = np.sqrt(found.squared_error / number) if number else np.nan
    if number < FEWEST_LINKS:
        return failed("too_few_links", number, rmse, inlier_ratio)
    weights = link_weights(found)
    matrix = information(homogeneous(points), weights)
    if is_singular(matrix, number):
        return failed("degenerate", number, rmse, inlier_ratio)
    if source_variance is None or reference_variance is None:
        variance = residual_variance(found)
        source_variance = np.full(len(points), variance)
        reference_variance = np.full(len(reference), variance)
    if links == "shared":
        scatter = shared_scatter(found, weights, source_variance, reference_variance)
    else:
        scatter = independent_scatter(found, source_variance, reference_variance)
    covariance = sandwich(matrix, scatter)
    status = of_definite("ok", covariance)
    if status != "ok":
        return failed(status, number, rmse, inlier_ratio)
    moved = np.linalg.solve(matrix, normal_sum(found))
    bias = (source_variance.mean() + reference_variance.mean()) * np.outer(moved, moved)
    return Linearised(covariance, status, bias, number, rmse, inlier_ratio)


def kept_links(
    reference: icp.Reference, points: np.ndarray, T: np.ndarray, chain: icp.Chain
) -> Links:
    """The `Links` that a chain keeps of source points (m, 3) [m] at the pose T (4, 4)."""
    from icpshap import icp

    moved = se3.transform(T, points)
    limit = np.inf if chain.maximum_distance is None else chain.maximum_distance**2
    distance, rows = icp.Matcher(reference, chain.matches)(moved, limit)
    kept = _closest(distance, chain.outlier_filter)
    if not chain.error_minimiser.needs_normals:
        return Links(points, None, rows, kept, distance[kept].sum())
    planes = reference.in_rows(reference.planes)
    normals = planes[:, :3]
    centred = np.column_stack([moved - reference.mean, np.full(len(moved), -1.0)])
    residual = (planes[rows] @ centred[:, :, None])[..., 0]
    behind = planes[:, 3] + normals @ reference.mean > 0
    towards = np.where(behind[:, None], -normals, normals) @ T[:3, :3]
    return Links(points, towards, rows, kept, np.square(residual[kept]).sum())


def _closest(distance, outlier_filter):
    """Which of the links (m, k) of squared length `distance` an icp.Trimmed keeps."""
    made = distance[np.isfinite(distance)]
    rank = outlier_filter.rank(np.array([made.size]))[0]
    limit = np.partition(made, rank)[rank] if rank < made.size else np.finfo(float).max
    return distance <= limit


def homogeneous(points: np.ndarray) -> np.ndarray:
    """Points (m, 3) with a fourth coordinate of 1."""
    return np.column_stack([points, np.ones(len(points))])


# B = sum_a h_a JACOBIAN[a] moves the homogeneous point h by B xi: [-[s]x, I] where h_3 = 1.
JACOBIAN = np.zeros((4, 3, 6))
JACOBIAN[:3, :, :3] = -se3.hat(np.eye(3))
JACOBIAN[3, :, 3:] = np.eye(3)


def information(points: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Sum of B^T W B (6, 6) over homogeneous points (m, 4) with weights (m, 3, 3).

    All moments sum_i h_a h_b W of the points at once, one product of matrices.
    """
    products = points[:, :, None] * points[:, None, :]
    moments = products.reshape(-1, 16).T @ weights.reshape(-1, 9)
    moments = moments.reshape(4, 4, 3, 3)
    return np.einsum("axr,abxy,bys->rs", JACOBIAN, moments, JACOBIAN, optimize=True)


def link_weights(links: Links, factors: np.ndarray | float = 1.0) -> np.ndarray:
    """Sum of factor W (m, 3, 3) over the kept links of each source point; factors (m, k)."""
    factors = links.kept * factors
    if links.normals is None:
        return factors.sum(axis=1)[:, None, None] * np.eye(3)
    normals = links.normals[links.reference]
    return np.swapaxes(factors[..., None] * normals, 1, 2) @ normals


def independent_scatter(
    links: Links, source_variance: np.ndarray, reference_variance: np.ndarray
) -> np.ndarray:
    """Covariance (6, 6) of the gradient where each kept link has noise of its own.

    What stands between H^-1 and H^-1; source_variance (m,), reference_variance (n,) [m^2].
    """
    of_link = source_variance[:, None] + reference_variance[links.reference]
    return information(homogeneous(links.points), link_weights(links, of_link))


def shared_scatter(
    links: Links, weights: np.ndarray, source_variance: np.ndarray, reference_variance: np.ndarray
) -> np.ndarray:
    """The same where the links of a point share its noise; weights (m, 3, 3): `link_weights`."""
    points = homogeneous(links.points)
    # W W = W of each link, but not of a sum of them.
    of_source = information(points, source_variance[:, None, None] * (weights @ weights))
    used = links.reference[links.kept]
    of_links = points[np.nonzero(links.kept)[0]]
    number = len(reference_variance)
    sums = np.stack([np.bincount(used, column, number) for column in of_links.T], axis=-1)
    # All links of a reference point have its normal, so that B is summed and W is not.
    linked = sums[:, 3] > 0
    if links.normals is None:
        weights = np.broadcast_to(np.eye(3), (int(linked.sum()), 3, 3))
    else:
        normals = links.normals[linked]
        weights = normals[:, :, None] * normals[:, None, :]
    weights = reference_variance[linked, None, None] * weights
    return of_source + information(sums[linked], weights)


def normal_sum(links: Links) -> np.ndarray:
    """Sum of B^T n (6,) over the kept links; NaN without planes."""
    if links.normals is None:
        return np.full(6, np.nan)
    normals = np.einsum("mk,mka->ma", links.kept.astype(float), links.normals[links.reference])
    return np.concatenate([np.cross(links.points, normals).sum(axis=0), normals.sum(axis=0)])


def residual_variance(links: Links) -> float:
    """Variance [m^2] on each coordinate of both clouds that the residuals of kept links suggest.

    A residual has the noise of two points; a link has one residual or, without planes, three.
    """
    residuals = links.number * (1 if links.normals is not None else 3)
    return links.squared_error / (2 * (residuals - 6))


def is_singular(matrix: np.ndarray, terms: int) -> bool:
    """Whether a sum H (6, 6) of that many terms leaves a direction undetermined."""
    scale = np.sqrt(
        np.maximum(np.diagonal(matrix), 1e-300)
    )  # must not depend on the unit of length
    values = np.linalg.eigvalsh(matrix / np.outer(scale, scale))
    return values[0] <= max(SINGULAR, 6 * ROUNDING * terms) * values[-1]


def sandwich(matrix: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """H^-1 scatter H^-1 (6, 6), symmetric."""
    half = np.linalg.solve(matrix, scatter)
    covariance = np.linalg.solve(matrix, half.T)
    return 0.5 * (covariance + covariance.T)
