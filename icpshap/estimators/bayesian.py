"""Bayesian ICP: a chain of poses by stochastic gradient Langevin dynamics.

Maken, Ramos, Ott, "Estimating Motion Uncertainty with Bayesian ICP", ICRA 2020, on the mean
gradients of their "Speeding up Iterative Closest Point Using Stochastic Gradient Descent", ICRA
2019; constants as released.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from icpshap.estimators._point_to_point import errors, minibatches_of, pose_of, transformation_of
from icpshap.estimators.kind import Kind, Returns, Samples
from icpshap.estimators.perturb import FEWEST_POINTS
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap.estimators._point_to_point import Errors
    from icpshap.estimators.perturb import Group


FEWEST_LINKS = 3  # without which an iteration is skipped
FEWEST_SAMPLES = 7  # whose covariance can have full rank
RELEASED_VARIANCE = 0.125  # of the prior, m^2 and rad^2


@dataclass(frozen=True)
class Bayesian(Kind):
    """Every state of a chain after `burn_in` is a sample, all of the same weight.

    The states depend on one another: `icpshap.explanation.chains.effective_sample_size` says how
    many independent samples they are worth.

    The chain of noise draw k begins at the initial pose of the first of its runs, takes the
    mini-batches of iterations k m to (k + 1) m - 1, of m `iterations`, and the normal numbers of
    the stream `langevin/<k>`, whatever the number of draws is. All settings of a pair share these
    draws. A state after an iteration that was skipped for want of links has `too_few_links`; a
    chain that leaves the numbers is `degenerate`, and keeps its first pose.
    """

    name: ClassVar = "bayesian"
    returns: ClassVar = Returns(samples=True, covariances=False, chain=True)
    one_subsample: ClassVar = True

    variant: int = option(
        1,
        "1: noise by the root of the step, as Langevin dynamics have it; 2: by the step, so that "
        "the spread is that of the step's own jitter. Both are released",
        unit="-",
        choices=(1, 2),
    )
    iterations: int = option(
        2500, "Iterations of the chain of a noise draw", unit="-", minimum=8, maximum=1_000_000
    )
    burn_in: int = option(
        500,
        "First iterations, which give no samples; at least 7 must be left",
        unit="-",
        minimum=0,
        maximum=1_000_000,
    )
    batch: int = option(
        150, "Source points of a mini-batch", unit="-", minimum=3, maximum=1_000_000
    )
    maximum_distance: float = option(
        1.0, "Longer links are not made", unit="m", above=0, maximum=1e6
    )
    prior: str = option(
        "released",
        "Variance of the prior about the true pose. released: 0.125 m^2 and rad^2; initial_pose: "
        "that of the setting's initial poses",
        choices=("released", "initial_pose"),
    )

    @property
    def conflict(self) -> str:
        samples = self.iterations - self.burn_in
        if samples >= FEWEST_SAMPLES:
            return ""
        return (
            f"burn_in: {self.burn_in} of {self.iterations} iterations leave {max(0, samples)} "
            f"samples, expected at least {FEWEST_SAMPLES}. "
            "Hint: a smaller burn_in or more iterations"
        )

    @property
    def made_of(self) -> str:
        return "scatter of states of a Markov chain"

    def spread(self, noise_draws: int) -> str:
        return (
            "The spread is that of the states of a Markov chain (stochastic gradient Langevin "
            "dynamics) at a likelihood of 1 m a point, whatever the sensor's noise is."
        )

    def number_of_runs(self, noise_draws: int) -> int:
        return (self.iterations - self.burn_in) * noise_draws

    def estimate(self, group: Group) -> Iterator[Samples]:
        from icpshap import icp  # compiled code is loaded where it runs, not where options are read

        match = icp.Matcher(icp.Reference(group.reference), 1)
        generator = group.streams.generator(f"langevin/{group.noise_draw}")
        normals = generator.standard_normal((self.iterations, 6))
        for start in group.starts:
            yield self._samples(group, start, match, normals)

    def _samples(self, group, start, match, normals):
        rows = start.rows[0]
        begin = pose_of(start.T_initial[0])
        if len(rows) < FEWEST_POINTS:
            found = Chain.failed(begin, self.iterations, "too_few_links")
        else:
            batches = minibatches_of(group, start, self.iterations, self.batch)
            found = chain(
                begin,
                lambda t, x: errors(
                    x[None],
                    start.source[batches[t]],
                    group.reference,
                    match,
                    self.maximum_distance**2,
                    closest_only=True,
                ),
                Prior(pose_of(group.pair.T_reference_source), self._variance(start)),
                len(rows),
                normals,
                self.variant,
            )
        kept = slice(self.burn_in, None)
        return Samples(
            start.setting,
            group.noise_draw,
            group.runs,
            transformation_of(found.states[kept]),
            np.repeat(start.initial_xi[:1], len(group.runs), axis=0),
            np.arange(1, self.iterations + 1)[kept],
            found.status[kept],
            found.rmse[kept],
            found.links[kept] / self.batch,
        )

    def _variance(self, start):
        if self.prior == "released":
            return np.full(6, RELEASED_VARIANCE)
        rotation, translation = np.split(start.initial_deviation**2, 2)
        return np.concatenate([translation, rotation])


class Prior(NamedTuple):
    """Of a pose: mean (6,) and variance (6,) [m, rad]."""

    mean: np.ndarray
    variance: np.ndarray

    def gradient(self, pose: np.ndarray) -> np.ndarray:
        """Gradient (6,) of the negative log density; of an angle by its sine, as released."""
        difference = pose - self.mean
        difference[3:] = np.sin(difference[3:])
        return difference / self.variance


class Chain(NamedTuple):
    """States (n, 6) after each iteration, and of its mini-batch: links (n,), rmse (n,) [m]."""

    states: np.ndarray
    status: np.ndarray
    links: np.ndarray
    rmse: np.ndarray

    @classmethod
    def failed(cls, pose: np.ndarray, iterations: int, status: str) -> Chain:
        """A chain that stays at the pose (6,) where it begins."""
        return cls(
            np.tile(pose, (iterations, 1)),
            np.full(iterations, status),
            np.zeros(iterations),
            np.full(iterations, np.nan),
        )


def chain(
    begin: np.ndarray,
    likelihood: Callable[[int, np.ndarray], Errors],
    prior: Prior,
    points: int,
    normals: np.ndarray,
    variant: int,
) -> Chain:
    """The `Chain` of poses that begins at one (6,); as long as its normal numbers (n, 6).

    likelihood(iteration, pose): `Errors` of a mini-batch of that iteration; points: number of
    source points, for which the mini-batch stands.
    """
    result = Chain.failed(begin, len(normals), "too_few_links")
    pose, square = begin, np.zeros(6)
    for iteration, normal in enumerate(normals):
        error = likelihood(iteration, pose)
        result.links[iteration], result.rmse[iteration] = error.links[0], error.rmse[0]
        if error.links[0] >= FEWEST_LINKS:
            gradients = error.gradient[0], prior.gradient(pose)
            pose, square = step(pose, square, *gradients, points, normal, variant)
            if not np.isfinite(pose).all():
                return Chain.failed(begin, len(normals), "degenerate")
            result.status[iteration] = "ok"
        result.states[iteration] = pose
    return result


def step(
    pose: np.ndarray,
    square: np.ndarray,
    gradient: np.ndarray,
    prior_gradient: np.ndarray,
    points: int,
    normal: np.ndarray,
    variant: int,
) -> tuple[np.ndarray, np.ndarray]:
    """The next pose (6,) of a chain, and the running mean (6,) of squared gradients.

    gradient (6,): mean over the links; prior_gradient (6,); points: number of source points;
    normal (6,): standard normal numbers.
    """
    total = points * gradient + prior_gradient
    scaled_by = gradient if variant == 1 else total
    square = 0.9 * square + 0.1 * np.square(scaled_by)
    size = (0.06147 / points if variant == 1 else 0.1) / (1e-8 + np.sqrt(square))
    noise = np.sqrt(size) if variant == 1 else size
    return pose - size / 2 * total + noise * normal, square
