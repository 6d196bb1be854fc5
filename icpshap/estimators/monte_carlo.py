"""ICP from many initial poses, each end a pose sample (paper, "Pose Uncertainty Estimation")."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from icpshap.estimators import closed_form, perturb
from icpshap.estimators._chain import ChainKind
from icpshap.estimators.kind import SAMPLES, Covariance, Samples, told
from icpshap.options import option

FEWEST_DRAWS = 10  # from which the scatter of draws is a covariance
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
    """`runs` registrations of a setting by the chain that the other options describe.

    Their spread shows subsamples, initial poses and the stopping rule. With `sensor_sigma` it holds
    the sensor's own noise besides: by `draws`, white noise of sqrt(sensor_sigma^2 + sigma^2) on
    both scans in every noise draw of every setting, an upper bound, since the scans hold their own
    already; by `closed_form`, the covariance of held matches of all usable points, a lower bound,
    since matches and normals do not stay as they are.
    """

    name: ClassVar = "monte_carlo"
    returns: ClassVar = SAMPLES

    sensor_sigma: float = option(
        0.0,
        "Standard deviation of the sensor's own noise on each coordinate of both scans, which "
        "every setting then has, the clean one included; 0 leaves it out",
        unit="m",
        minimum=0,
        maximum=100,
        variant=True,
    )
    sensor_noise_by: str = option(
        "draws",
        "How the spread holds the noise of sensor_sigma. draws: it is drawn, in at least "
        f"{FEWEST_DRAWS} noise draws (an upper bound); closed_form: the closed form of all usable "
        "points is added (a lower bound)",
        choices=("draws", "closed_form"),
        variant=True,
    )

    def number_of_runs(self, noise_draws):
        return self.runs

    @property
    def _adds_closed_form(self):
        return self.sensor_sigma > 0 and self.sensor_noise_by == "closed_form"

    def returned(self, noise_draws):
        return replace(
            self.returns,
            covariances=self._adds_closed_form,
            sensor_sigma=self.sensor_sigma,
            drawn=self.drawn_sigma > 0,
            # Several draws vary what the setting's own noise does; one does not.
            together=noise_draws == 1 or not self._adds_closed_form,
        )

    def spread(self, noise_draws):
        runs = (
            "The spread of a setting is that of its runs: of initial poses, of subsamples and of "
        )
        runs += "where the iteration stops"
        if not self.sensor_sigma:
            return f"{runs}; what the sensor's own noise adds to it is left out."
        own = told(self.sensor_sigma)
        if self.drawn_sigma:
            return (
                f"{runs}, and of white noise of {own} for the sensor's own, drawn on both scans in "
                f"each of {noise_draws} noise draws of every setting: an upper bound, since the "
                "scans hold their own already."
            )
        also = " and of the setting's sensor noise" * (noise_draws == 1)
        return (
            f"{runs}. Added is the closed form of the sensor's own noise, told {own}{also}, of all "
            "usable points with matches held: a lower bound, since matches and normals change."
        )

    @property
    def drawn_sigma(self):
        return 0.0 if self._adds_closed_form else self.sensor_sigma

    @property
    def fewest_noise_draws(self):
        return FEWEST_DRAWS if self.drawn_sigma else 1

    def estimate(self, group):
        from icpshap import icp

        chain = self.chain()
        number = len(group.runs)
        reference = icp.Reference(group.reference, self.normal_neighbours)
        for batch in perturb.batches(group.starts, max(1, RUNS_AT_ONCE // number)):
            rows = [run for start in batch for run in start.rows]
            T_initial = np.concatenate([start.T_initial for start in batch])
            result = icp.register(reference, batch[0].source, rows, T_initial, chain)
            if self._adds_closed_form:
                yield from self._closed_forms(group, reference, batch, chain)
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

    def _closed_forms(self, group, reference, starts, chain):
        """A `Covariance` of each start: what the sensor's own noise does to all usable points.

        At the end of a run from the true pose, for planes whatever the chain's metric: held matches
        tell nothing of how points slide along a surface.
        """
        from icpshap import icp

        planes = replace(chain, error_minimiser=icp.PointToPlane())
        # With one noise draw the runs share the setting's noise as well, so that it is added, too.
        together = len(group.runs) == self.runs
        for same in perturb.alike(starts, "usable"):
            source, usable = same[0].source, np.flatnonzero(same[0].usable).astype(np.int32)
            run = icp.register(
                reference, source, [usable], group.pair.T_reference_source[None], chain
            )
            T, status = run.T_reference_source[0], run.status[0]
            found = closed_form.failed(status)
            if status in closed_form.USABLE:
                told = (same[0].source_variance[usable], group.reference_variance)
                variances = [self.sensor_sigma**2 + together * variance for variance in told]
                found = closed_form.of_clouds(reference, source[usable], T, planes, *variances)
            for start in same:
                yield Covariance(
                    start.setting,
                    group.noise_draw,
                    T,
                    found.covariance,
                    run.iterations[0],
                    found.status,
                    found.rmse,
                    found.inlier_ratio,
                )
