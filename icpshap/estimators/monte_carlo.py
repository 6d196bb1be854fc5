"""ICP from many initial poses, each end a pose sample (paper, "Pose Uncertainty Estimation")."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from icpshap.estimators import perturb
from icpshap.estimators._chain import ChainKind
from icpshap.estimators.kind import SAMPLES, Samples
from icpshap.options import option

RUNS_AT_ONCE = 1200  # runs that go through the search index together; more only cost memory


@dataclass(frozen=True)
class Runs:
    """How many runs a setting has: a part, so that it comes before the options of the chain."""

    runs: int = option(
        100,
        'ICP runs of a setting (paper, "Pose Uncertainty Estimation"); from fewer than 50, no '
        "uncertainty is computed",
        unit="-",
        minimum=50,
        maximum=100000,
    )


@dataclass(frozen=True)
class MonteCarlo(ChainKind, Runs):
    """`runs` registrations of a setting by the chain that the other options describe."""

    name: ClassVar = "monte_carlo"
    returns: ClassVar = SAMPLES

    def number_of_runs(self, noise_draws):
        return self.runs

    def estimate(self, group):
        from icpshap import icp

        chain = self.chain()
        number = len(group.runs)
        reference = icp.Reference(group.reference, self.normal_neighbours)
        for batch in perturb.batches(group.starts, max(1, RUNS_AT_ONCE // number)):
            rows = [run for start in batch for run in start.rows]
            T_initial = np.concatenate([start.T_initial for start in batch])
            result = icp.register(reference, batch[0].source, rows, T_initial, chain)
            for k, start in enumerate(batch):
                part = slice(k * number, (k + 1) * number)
                yield Samples(
                    start.setting,
                    group.noise_draw,
                    group.runs,
                    result.T_reference_source[part],
                    start.initial_xi,
                    result.iterations[part],
                    result.status[part],
                    result.rmse[part],
                    result.inlier_ratio[part],
                )
