"""SVN-ICP: particles that repel one another and take Newton steps.

"SVN-ICP: Uncertainty Estimation of ICP-based LiDAR Odometry using Stein Variational Newton", 2025,
as released with `SVN_full_grad: false`, but for its candidates: each point's match is the nearest
of all reference points, not of 100.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from icpshap import se3
from icpshap.estimators._particles import differences, lower_median
from icpshap.estimators.kind import Kind, Returns, Samples
from icpshap.estimators.perturb import FEWEST_POINTS
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap.estimators.perturb import Group


FEWEST_LINKS = 3  # that determine a pose
DAMPING = 1e-6  # on the diagonal of every Hessian


@dataclass(frozen=True)
class SteinNewton(Kind):
    """Particles are the samples of a setting.

    All see the subsample of the first run of a noise draw: its number of points decides how far
    they spread, since a link has the variance 1 m^2. Noise draw k has particles, initial poses and
    mask k n to (k + 1) n - 1, of n `particles`, whatever the number of draws is; all settings of a
    pair share these draws.

    Particles that did not stop have the status `max_iterations`, one with fewer than 3 links at the
    end `too_few_links`; if the particles collapse into one point all are `degenerate`, and keep
    their initial poses.
    """

    name: ClassVar = "stein_newton"
    returns: ClassVar = Returns(samples=True, covariances=False)
    one_subsample: ClassVar = True

    particles: int = option(
        30, "Particles of a setting in one noise draw", unit="-", minimum=7, maximum=10_000
    )
    maximum_iterations: int = option(
        100,
        "Particles stop at the latest after this many iterations",
        unit="-",
        minimum=1,
        maximum=10_000,
    )
    stop: float = option(
        5e-4,
        "Particles stop when the mean length of their steps, in m and rad, is below this",
        unit="-",
        minimum=0,
        maximum=10,
    )
    curvature: str = option(
        "mean",
        "How the kernel joins the particles' Hessians. mean: each takes its own Newton step, and "
        "they repel one another by the mean Hessian (the default of the released program); full: "
        "the Newton step of the Stein functional",
        choices=("mean", "full"),
    )
    maximum_distance: float = option(
        3.0,
        "m of the weight (m / (m + 3 |e|))^2 of a link of length e; it is made where e^2 < m "
        "[m^2], as released",
        unit="m",
        above=0,
        maximum=1e6,
    )

    @property
    def made_of(self) -> str:
        return "scatter of particles of SVN-ICP"

    def spread(self, noise_draws: int) -> str:
        return (
            "The spread is that of particles that take Newton steps (SVN-ICP) at a likelihood of "
            "1 m a point of one subsample, whatever the sensor's noise is."
        )

    def number_of_runs(self, noise_draws: int) -> int:
        return self.particles * noise_draws

    def estimate(self, group: Group) -> Iterator[Samples]:
        from icpshap import icp  # compiled code is loaded where it runs, not where options are read

        match = icp.Matcher(icp.Reference(group.reference), 1)

        def nearest(points):
            squared, rows = match(points, self.maximum_distance)
            return squared[:, 0], group.reference[rows[:, 0]]

        for start in group.starts:
            yield self._samples(group, start, nearest)

    def _samples(self, group, start, nearest):
        source = start.source[start.rows[0]]
        if len(source) < FEWEST_POINTS:
            moved = Particles.failed(start.T_initial, "too_few_links")
        else:
            moved = self.moved(start.T_initial, group.pair.T_reference_source, source, nearest)
        return Samples(
            start.setting,
            group.noise_draw,
            group.runs,
            moved.T_reference_source,
            start.initial_xi,
            np.full(self.particles, moved.iterations),
            moved.status,
            moved.rmse,
            moved.links / max(1, len(source)),
        )

    def moved(
        self,
        T_initial: np.ndarray,
        T_mean: np.ndarray,
        source: np.ndarray,
        nearest: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    ) -> Particles:
        """The `Particles` that begin at T_initial (k, 4, 4), on source points (n, 3) [m].

        T_mean (4, 4): the pose to which their coordinates refer; nearest(points): of points (m, 3)
        in the reference frame squared distance (m,) [m^2] and place (m, 3) of their matches.
        """
        relative = se3.inverse(T_mean) @ T_initial
        stopped, iterations = False, 0
        while not stopped and iterations < self.maximum_iterations:
            T = T_mean @ relative
            found = linearise(T, source, nearest, self.maximum_distance)
            at = coordinates(relative), found.hessian, found.gradient
            steps = (newton_steps if self.curvature == "mean" else full_newton_steps)(*at)
            if not np.isfinite(steps).all():
                return Particles.failed(T_initial, "degenerate")
            relative = stepped(relative, steps)
            stopped = np.linalg.norm(steps, axis=1).mean() < self.stop
            iterations += 1
        ended = "ok" if stopped else "max_iterations"
        status = np.where(found.links < FEWEST_LINKS, "too_few_links", ended)
        return Particles(T_mean @ relative, iterations, status, found.links, found.rmse)


class Particles(NamedTuple):
    """Where k particles ended (k, 4, 4), and in their last linearisation: links (k,), rmse (k,)."""

    T_reference_source: np.ndarray
    iterations: int
    status: np.ndarray
    links: np.ndarray
    rmse: np.ndarray

    @classmethod
    def failed(cls, T_initial: np.ndarray, status: str) -> Particles:
        """Particles that stay where they begin, (k, 4, 4)."""
        number = len(T_initial)
        nothing = np.zeros(number), np.full(number, np.nan)
        return cls(T_initial, 0, np.full(number, status), *nothing)


class Linearisation(NamedTuple):
    """Of k particles: hessian (k, 6, 6), gradient (k, 6), links (k,), rmse (k,) [m]."""

    hessian: np.ndarray
    gradient: np.ndarray
    links: np.ndarray
    rmse: np.ndarray


def linearise(
    T: np.ndarray,
    source: np.ndarray,
    nearest: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    limit: float | None,
) -> Linearisation:
    """The `Linearisation` at poses T (k, 4, 4), by the translation and rotation of `stepped`.

    source (n, 3) [m]; nearest: as in `SteinNewton.moved`; limit: the option maximum_distance.
    """
    from icpshap.estimators._stein_newton_sums import normal_equations

    rotation = np.ascontiguousarray(T[:, :3, :3])
    points = source @ np.swapaxes(rotation, 1, 2) + T[:, None, :3, 3]
    squared, matched = nearest(points.reshape(-1, 3))
    squared = squared.reshape(points.shape[:2])
    error = points - matched.reshape(points.shape)
    hessian, gradient = normal_equations(rotation, source, error, squared, limit)
    linked = squared < limit
    links = linked.sum(axis=1)
    with np.errstate(invalid="ignore"):
        rmse = np.sqrt(np.where(linked, squared, 0.0).sum(axis=1) / links)
    return Linearisation(hessian + DAMPING * np.eye(6), gradient, links, rmse)


def coordinates(T: np.ndarray) -> np.ndarray:
    """Translation and rotation vector (k, 6) of transformations (k, 4, 4)."""
    return np.concatenate([T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]).as_rotvec()], axis=1)


def newton_steps(particles: np.ndarray, hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Steps (k, 6) of particles (k, 6): Newton's, averaged by the kernel, and the repulsion.

    hessian (k, 6, 6), gradient (k, 6): of each. NaN if most particles coincide.
    """
    kernel, repulsion = kernels(particles)
    own = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
    apart = np.linalg.solve(hessian.mean(axis=0), repulsion.sum(axis=1).T).T
    return (np.einsum("ij,jd->id", kernel, own) + apart) / kernel.sum(axis=1)[:, None]


def full_newton_steps(
    particles: np.ndarray, hessian: np.ndarray, gradient: np.ndarray
) -> np.ndarray:
    """The same (k, 6) by the Newton step of the Stein functional itself, block by block.

    Detommaso, Cui, Spantini, Marzouk, Scheichl, "A Stein variational Newton method" (NeurIPS 2018),
    Eq. 19 with a block diagonal matrix.
    """
    kernel, repulsion = kernels(particles)
    if not np.isfinite(kernel).all():
        return np.full_like(particles, np.nan)
    curvature = np.einsum("ij,jab->iab", kernel**2, hessian)
    curvature += np.einsum("ija,ijb->iab", repulsion, repulsion)
    right = repulsion.sum(axis=1) - np.einsum("ij,jd->id", kernel, gradient)
    return np.linalg.solve(curvature, right[..., None])[..., 0]


def kernels(particles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Kernel (k, k) of particles (k, 6), and how each pushes another away (k, k, 6)."""
    difference, squared = differences(particles)
    with np.errstate(invalid="ignore", divide="ignore"):
        width = lower_median(squared) / np.log(len(particles) + 1)
        kernel = np.exp(-squared / width)
        return kernel, 2 / width * kernel[..., None] * difference


def stepped(T: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Transformations (k, 4, 4) after steps (k, 6), translation first.

    As released, the translation of exp(step) is turned by the new rotation, not by the old one.
    """
    step = se3.exp(np.concatenate([steps[:, 3:], steps[:, :3]], axis=1))
    result = T.copy()
    result[:, :3, :3] = T[:, :3, :3] @ step[:, :3, :3]
    result[:, :3, 3] += (result[:, :3, :3] @ step[:, :3, 3:])[..., 0]
    return result
