"""Covariances that mapping programs make of the fitness score: their numbers, whatever the scans.

hdl_graph_slam (Koide et al. 2019; information_matrix_calculator.cpp) and LIO-SAM (Shan et al. 2020;
mapOptmization.cpp).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap import se3
from icpshap.estimators import perturb
from icpshap.estimators._chain import ChainKind
from icpshap.estimators.kind import COVARIANCES, GOOD_STATUS, UNSHARED, Covariance, of_definite
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap.estimators.perturb import Group


# Of hdl_graph_slam: var_gain_a, fitness_score_thresh [m^2], and the squares of min_stddev and
# max_stddev of q [rad] and x [m].
GAIN, LARGEST_SCORE = 20.0, 0.5
ROTATION, TRANSLATION = np.square([0.05, 0.2]), np.square([0.1, 5.0])


@dataclass(frozen=True)
class Fitness(ChainKind):
    """A covariance of the mean squared distance to the nearest reference points, after the chain.

    The chain starts at the true pose, with the first run's rows.
    """

    name: ClassVar = "fitness"
    returns: ClassVar = COVARIANCES
    sees: ClassVar = UNSHARED

    formula: str = option(
        "hdl_graph_slam",
        "hdl_graph_slam: variances between two fixed ones for rotation and for translation; "
        "lio_sam: the score itself is the variance of all six [rad^2, m^2]",
        choices=("hdl_graph_slam", "lio_sam"),
    )

    def spread(self, noise_draws: int) -> str:
        return (
            "The covariance is a formula of the mean squared distance to the nearest points, with "
            f"the constants of {self.formula}: it knows no direction, and was told no noise."
        )

    @property
    def made_of(self) -> str:
        return f"fitness score, as in {self.formula}"

    def estimate(self, group: Group) -> Iterator[Covariance]:
        from icpshap import icp

        reference = self.reference(group.reference)
        nearest = icp.Matcher(reference)
        for same in perturb.alike(group.starts):
            run = self.from_truth(group, reference, same[0])
            T, status = run.T_reference_source[0], run.status[0]
            covariance = np.full((6, 6), np.nan)
            if status in GOOD_STATUS:
                points = same[0].source[same[0].rows[0]]
                score = nearest(se3.transform(T, points))[0].mean()
                covariance = np.diag(FORMULAS[self.formula](score))
                status = of_definite(status, covariance)
            for start in same:
                yield Covariance(
                    start.setting,
                    group.noise_draw,
                    T,
                    covariance,
                    run.iterations[0],
                    status,
                    run.rmse[0],
                    run.inlier_ratio[0],
                )


def hdl_graph_slam(score: float) -> np.ndarray:
    """Variances (6,) [rad^2 x3, m^2 x3] of a fitness score [m^2]."""
    grown = (1 - np.exp(-GAIN * score)) / (1 - np.exp(-GAIN * LARGEST_SCORE))
    return np.repeat([low + (high - low) * grown for low, high in (ROTATION, TRANSLATION)], 3)


def lio_sam(score: float) -> np.ndarray:
    """Variances (6,) [rad^2 x3, m^2 x3] of a fitness score [m^2]."""
    return np.full(6, score)


FORMULAS = {"hdl_graph_slam": hdl_graph_slam, "lio_sam": lio_sam}
