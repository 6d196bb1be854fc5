"""Stein ICP: particles that repel one another follow a posterior of the pose.

Maken, Ramos, Ott, "Stein ICP for Uncertainty Estimation in Point Cloud Matching", RA-L 2022, as
released, but for one thing: the width of the kernel is not differentiated (the released gradient
runs through a median into one arbitrary particle, and cannot be reproduced).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap.estimators._particles import differences, lower_median
from icpshap.estimators._point_to_point import errors, minibatches_of, pose_of, transformation_of
from icpshap.estimators.kind import Kind, Returns, Samples
from icpshap.estimators.perturb import FEWEST_POINTS
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap import icp
    from icpshap.estimators._point_to_point import Errors
    from icpshap.estimators.perturb import Group


FEWEST_LINKS = 3  # that determine a pose
WINDOW = 10  # last iterations, over which a spread may not shrink any more
SHRINKS = 0.1  # share of the standard deviations; mini-batches alone make it vary by half of that


@dataclass(frozen=True)
class Stein(Kind):
    """Particles are the samples of a setting; they share their mini-batches.

    Noise draw k has particles and initial poses k n to (k + 1) n - 1, of n `particles`, and the
    mini-batches of iterations k m to (k + 1) m - 1, of m `iterations`, whatever the number of draws
    is. All settings of a pair share these draws.

    There is no stopping rule. Samples of a setting whose spread shrank by more than 10 % over the
    last 10 iterations have the status `max_iterations`, and count like those that are `ok`. A
    particle with fewer than 3 links in its last mini-batch has `too_few_links`; if the particles
    collapse into one point all are `degenerate`, and keep their initial poses.
    """

    name: ClassVar = "stein"
    returns: ClassVar = Returns(samples=True, covariances=False)
    one_subsample: ClassVar = True

    particles: int = option(
        100, "Particles of a setting in one noise draw", unit="-", minimum=7, maximum=10_000
    )
    iterations: int = option(
        150, "Iterations of the particles", unit="-", minimum=WINDOW + 1, maximum=100_000
    )
    batch: int = option(
        150, "Source points of a mini-batch", unit="-", minimum=3, maximum=1_000_000
    )
    maximum_distance: float = option(
        1.0,
        "A link is made where its squared distance is at most this times c [m], the largest "
        "coordinate of both clouds (1 if not `normalise`)",
        unit="m",
        above=0,
        maximum=1e6,
    )
    normalise: bool = option(
        True, "Whether clouds and translations are divided by the largest coordinate of both clouds"
    )
    learning_rate: float = option(
        0.01, "Step size of Adam, for every coordinate", unit="-", above=0, maximum=1
    )
    likelihood_sigma: float = option(
        1.0,
        "Standard deviation of a point's error in the likelihood, times the root of c where "
        "normalised; 1 as released, which is deaf to noise of centimetres",
        unit="m",
        above=0,
        maximum=1e6,
    )

    @property
    def made_of(self) -> str:
        return "scatter of particles of Stein ICP"

    def spread(self, noise_draws: int) -> str:
        return (
            "The spread is that of particles that repel one another (Stein ICP), at a likelihood "
            f"of {self.likelihood_sigma:g} m a point, whatever the sensor's noise is."
        )

    def number_of_runs(self, noise_draws: int) -> int:
        return self.particles * noise_draws

    def estimate(self, group: Group) -> Iterator[Samples]:
        from icpshap import icp  # compiled code is loaded where it runs, not where options are read

        match = icp.Matcher(icp.Reference(group.reference), 1)
        for start in group.starts:
            rows = start.rows[0]
            if len(rows) < FEWEST_POINTS:
                yield self._failed(group, start, "too_few_links")
                continue
            batches = minibatches_of(group, start, self.iterations, self.batch)
            posterior = self.posterior(start.source, rows, group.reference, match, batches)
            near = pose_of(group.pair.T_reference_source)
            particles = posterior.normalised(pose_of(start.T_initial, near))
            yield self._samples(group, start, posterior, particles)

    def posterior(
        self,
        source: np.ndarray,
        rows: np.ndarray,
        reference: np.ndarray,
        match: icp.Matcher,
        batches: np.ndarray,
    ) -> Posterior:
        """The `Posterior` of a pose, given source (m, 3) [m] of which `rows` are usable.

        reference (n, 3) [m]; match: an icp.Matcher on it; batches (iterations, b): rows of each.
        """
        largest = max(np.abs(reference).max(), np.abs(source[rows]).max())
        return Posterior(
            source=source,
            reference=reference,
            match=match,
            batches=batches,
            points=len(rows),
            scale=largest if self.normalise else 1.0,
            maximum_distance=self.maximum_distance,
            likelihood_sigma=self.likelihood_sigma,
        )

    def _samples(self, group, start, posterior, particles):
        path: deque[np.ndarray] = deque(maxlen=WINDOW + 1)
        for now in moved(particles, posterior.score, self.iterations, self.learning_rate):
            if not np.isfinite(now).all():
                return self._failed(group, start, "degenerate")
            path.append(now)
        last = posterior.last
        status = "max_iterations" if still_shrinks(path[0], path[-1]) else "ok"
        return Samples(
            start.setting,
            group.noise_draw,
            group.runs,
            transformation_of(posterior.metric(path[-1])),
            start.initial_xi,
            np.full(self.particles, self.iterations),
            np.where(last.links < FEWEST_LINKS, "too_few_links", status),
            last.rmse,
            last.links / self.batch,
        )

    def _failed(self, group, start, status):
        none = np.zeros(self.particles)
        return Samples(
            start.setting,
            group.noise_draw,
            group.runs,
            start.T_initial,
            start.initial_xi,
            none.astype(int),
            np.full(self.particles, status),
            np.full(self.particles, np.nan),
            none,
        )


class Posterior:
    """Score of particles (k, 6), poses of which the translation is divided by `scale` [m]."""

    def __init__(
        self,
        source: np.ndarray,
        reference: np.ndarray,
        match: icp.Matcher,
        batches: np.ndarray,
        points: int,
        scale: float,
        maximum_distance: float,
        likelihood_sigma: float,
    ) -> None:
        self.source, self.reference, self.match = source, reference, match
        self.batches = batches
        self.limit = maximum_distance * scale
        self.unit = np.repeat([scale, 1.0], 3)
        # The mean gradient, of normalised errors by normalised poses, times the number of points.
        self.factor = -points / (scale * likelihood_sigma**2) * self.unit
        self.last: Errors | None = None

    def normalised(self, poses: np.ndarray) -> np.ndarray:
        """Particles (k, 6) of poses (k, 6) [m, rad]."""
        return poses / self.unit

    def metric(self, particles: np.ndarray) -> np.ndarray:
        """Poses (k, 6) [m, rad]."""
        return particles * self.unit

    def score(self, iteration: int, particles: np.ndarray) -> np.ndarray:
        """Gradient (k, 6) of the log density on the mini-batch of an iteration."""
        batch = self.source[self.batches[iteration]]
        poses = self.metric(particles)
        last = errors(poses, batch, self.reference, self.match, self.limit)
        self.last = last
        return self.factor * last.gradient


def moved(
    particles: np.ndarray,
    score: Callable[[int, np.ndarray], np.ndarray],
    iterations: int,
    learning_rate: float,
) -> Iterator[np.ndarray]:
    """Yields the particles (k, d) after each iteration of Stein variational gradient ascent.

    score(iteration, particles): gradient (k, d) of the log density at each. By Adam.
    """
    mean, square = np.zeros((2, *particles.shape))
    for iteration in range(iterations):
        gradient = -direction(particles, score(iteration, particles))
        mean = 0.9 * mean + 0.1 * gradient
        square = 0.999 * square + 0.001 * np.square(gradient)
        unbiased_mean = mean / (1 - 0.9 ** (iteration + 1))
        unbiased_square = square / (1 - 0.999 ** (iteration + 1))
        particles = particles - learning_rate * unbiased_mean / (np.sqrt(unbiased_square) + 1e-8)
        yield particles


def direction(particles: np.ndarray, scores: np.ndarray) -> np.ndarray:
    """Direction (k, d) in which particles (k, d) move, given their scores (Stein ICP, Eq. 6).

    NaN if most particles coincide.
    """
    difference, squared = differences(particles)
    with np.errstate(invalid="ignore", divide="ignore"):
        width = lower_median(squared) / (2 * np.log(len(particles)))
        kernel = np.exp(-squared / (2 * width))
        attraction = np.einsum("ij,jd->id", kernel, scores)
        repulsion = np.einsum("ij,ijd->id", kernel, difference) / width
    return (attraction + repulsion) / len(particles)


def still_shrinks(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether the spread of particles (k, 6) is smaller than before, in the mean by over 10 %."""
    change = np.log(after.std(axis=0) / before.std(axis=0)).mean()
    return change < np.log(1 - SHRINKS)
