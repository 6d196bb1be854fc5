"""ICP from many initial poses, each end a pose sample (paper, "Pose Uncertainty Estimation")."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap.estimators import perturb
from icpshap.estimators._chain import ChainKind
from icpshap.estimators._own_noise import OwnNoise, Runs
from icpshap.estimators.kind import SAMPLES, Samples

if TYPE_CHECKING:
    from icpshap.estimators.kind import Covariance
    from icpshap.estimators.perturb import Group


RUNS_AT_ONCE = 5000  # runs that go through the search index together; more only cost memory
ROWS_AT_ONCE = 50_000_000  # of their subsamples (200 MB)


@dataclass(frozen=True)
class MonteCarlo(OwnNoise, ChainKind, Runs):
    """`runs` registrations of a setting by the chain that the other options describe."""

    name: ClassVar = "monte_carlo"
    returns: ClassVar = SAMPLES

    def estimate(self, group: Group) -> Iterator[Samples | Covariance]:
        from icpshap import icp

        chain = self.chain()
        number = len(group.runs)
        reference = self.reference(group.reference)

        def from_all(points, T_initial):
            every = np.arange(len(points))
            run = icp.register(reference, points, [every], T_initial[None], chain)
            return run.T_reference_source[0], run.status[0], run.iterations[0]

        for batch in perturb.batches(group.starts, RUNS_AT_ONCE, ROWS_AT_ONCE):
            rows = [run for start in batch for run in start.rows]
            T_initial = np.concatenate([start.T_initial for start in batch])
            # Runs of one number use one subsample, but for points that their settings remove.
            packets = icp.numbered(batch[0].rows) * len(batch)
            result = icp.register(reference, batch[0].source, rows, T_initial, chain, packets)
            if self.adds_closed_form:
                yield from self.closed_forms(group, reference, batch, chain, from_all)
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
