"""How many minutes a job may take: what a cluster is told of it.

Measured seconds, of one core of an AMD EPYC (Zen 5), with a margin: for slower cores, and for runs
that take the most iterations, four times as many as the mean. No number depends on a limit.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from icpshap.estimators import Estimator

MARGIN = 4
FEWEST = 10  # minutes; a job that does nothing takes one
# Seconds for scans of a million points:

# Of a scan's index and normals (docs/engine.md, growth).
OF_REFERENCE = 2.0
# Of a run, for the source points that it uses, without the former: docs/engine.md, a pair of
# 367,000 points, and docs/estimators.md, speed.
OF_RUN = {
    "monte_carlo": 2.5,
    "closed_form": 2.0,
    "unscented": 6.0,
    "gicp": 10.0,
    "fitness": 2.0,
    "stein": 0.03,
    "stein_newton": 11.0,
    "bayesian": 0.002,
    "learned": 0.1,
}
# Of a kind that is not known here, a registration of one's own among them: a run of small_gicp on
# 365,000 points takes 9.93 s (docs/engine.md).
OF_ANY_RUN = 27.0
# Of what is made of a setting's runs, intervals included: 40 pairs of 9 settings took 3.4 s.
OF_EXPLANATION = 0.02


def minutes(seconds: float, attempt: int = 1) -> int:
    """The limit of a job that takes so many seconds; each further attempt has as much more."""
    return attempt * max(FEWEST, ceil(MARGIN * seconds / 60))


def seconds_of_settings(estimator: Estimator, number: int, points: int) -> float:
    """How long the registrations of so many settings take.

    estimator: an estimators.Estimator; points: of the larger scan.
    """
    perturbing = estimator.perturbing
    references = number * perturbing.noise_draws * OF_REFERENCE
    runs = number * estimator.number_of_runs * OF_RUN.get(estimator.kind.name, OF_ANY_RUN)
    return points / 1e6 * (references + runs * perturbing.subsampling_probability)
