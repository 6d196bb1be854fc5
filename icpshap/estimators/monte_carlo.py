"""ICP from many initial poses, each end a pose sample (paper, "Pose Uncertainty Estimation")."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from icpshap.estimators import perturb
from icpshap.estimators.kind import SAMPLES, Kind, Samples
from icpshap.options import option

RUNS_AT_ONCE = 1200  # runs that go through the search index together; more only cost memory


@dataclass(frozen=True)
class MonteCarlo(Kind):
    """`runs` registrations of a setting by the chain that the other options describe."""

    name: ClassVar = "monte_carlo"
    returns: ClassVar = SAMPLES

    runs: int = option(
        100,
        'ICP runs of a setting (paper, "Pose Uncertainty Estimation"); from fewer than 50, no '
        "uncertainty is computed",
        unit="-",
        minimum=50,
        maximum=100000,
    )
    metric: str = option(
        "point_to_plane",
        "Error metric of ICP",
        choices=("point_to_plane", "point_to_point"),
    )
    normal_neighbours: int = option(
        7,
        "Neighbours of a normal, the point itself included",
        unit="-",
        minimum=3,
        maximum=50,
    )
    matches: int = option(
        3, "Reference points linked to each source point", unit="-", minimum=1, maximum=5
    )
    kept_links: float = option(
        0.7,
        "Share of links, the closest, that the outlier filter keeps; 1 keeps all",
        unit="-",
        above=0,
        maximum=1,
    )
    maximum_distance: float | None = option(
        None, "Longer links are not made; null for no limit", unit="m", above=0, maximum=1e6
    )
    maximum_iterations: int = option(
        150,
        "ICP stops at the latest after this many iterations",
        unit="-",
        minimum=1,
        maximum=10000,
    )
    stop_rotation: float = option(
        0.001,
        "ICP stops when the mean of the last 3 steps is below this and below stop_translation",
        unit="rad",
        minimum=0,
        maximum=10,
    )
    stop_translation: float = option(
        0.01,
        "ICP stops when the mean of the last 3 steps is below this and below stop_rotation",
        unit="m",
        minimum=0,
        maximum=1e6,
    )

    def number_of_runs(self, noise_draws):
        return self.runs

    def chain(self):
        """The ICP chain that the options describe."""
        from icpshap import icp  # compiled code is loaded where it runs, not where options are read

        metrics = {"point_to_plane": icp.PointToPlane, "point_to_point": icp.PointToPoint}
        return icp.Chain(
            error_minimiser=metrics[self.metric](),
            matches=self.matches,
            outlier_filter=icp.Trimmed(self.kept_links),
            maximum_distance=self.maximum_distance,
            stopping=icp.Stopping(
                self.maximum_iterations, self.stop_rotation, self.stop_translation
            ),
        )

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
