"""How long a job takes, and how many minutes it may: what a cluster is told of it.

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
# Of a pair: what is known of it before it is registered; its diagnosis, with what each cause would
# do to it where others are held against it; whether an instance can be played on it; a registration
# that makes a pose.
OF_CHECK = 15.0
OF_DIAGNOSIS = 30.0
OF_PAIR_ALONE = 2.0
OF_INSTANCE = 15.0
OF_POSE = 20.0

# Seconds, whatever the points:

# Of what is made of a setting's runs: 0.0095 s where a pair has 9 settings of 100 runs, a seventh
# of that where it has 1,332; and what grows with the square of the runs: 0.2 s for 1,000.
OF_EXPLANATION = {"jackknife": 0.01, "bootstrap": 0.07}
OF_RUNS_TOGETHER = 0.2


def minutes(seconds: float, attempt: int = 1) -> int:
    """The limit of a job that takes so many seconds; each further attempt has as much more."""
    return attempt * max(FEWEST, ceil(MARGIN * seconds / 60))


def seconds_of_diagnosis(pairs: int, points: float) -> float:
    """How long the diagnosis of so many pairs takes, each beside the others.

    points: of the largest scan.
    """
    return points / 1e6 * (pairs * OF_DIAGNOSIS if pairs > 1 else OF_PAIR_ALONE)


def seconds_of_explanation(settings: int, runs: int, interval: str) -> float:
    """How long an explanation from so many settings takes, of so many runs each.

    interval: how intervals are made, an option of `explanation.method.Method`.
    """
    return settings * (OF_EXPLANATION[interval] + OF_RUNS_TOGETHER * (runs / 1000) ** 2)


def seconds_of_settings(estimator: Estimator, number: int, points: int) -> float:
    """How long the registrations of so many settings take.

    estimator: an estimators.Estimator; points: of the larger scan.
    """
    perturbing = estimator.perturbing
    references = number * perturbing.noise_draws * OF_REFERENCE
    runs = number * estimator.number_of_runs * OF_RUN.get(estimator.kind.name, OF_ANY_RUN)
    return points / 1e6 * (references + runs * perturbing.subsampling_probability)
