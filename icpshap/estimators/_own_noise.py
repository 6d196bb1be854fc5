"""The sensor's own noise in the spread of runs, for every kind that registers many times."""

from dataclasses import dataclass, replace

import numpy as np

from icpshap.estimators import closed_form, perturb
from icpshap.estimators.kind import GOOD_STATUS, Kind, told
from icpshap.options import option

FEWEST_DRAWS = 10  # from which the scatter of draws is a covariance


@dataclass(frozen=True)
class Runs:
    """How many runs a setting has: a part, so that it comes before the options of a chain."""

    runs: int = option(
        100,
        'ICP runs of a setting (paper, "Pose Uncertainty Estimation"); from fewer than 50, no '
        "uncertainty is computed",
        unit="-",
        minimum=50,
        maximum=100000,
    )


@dataclass(frozen=True)
class OwnNoise(Runs, Kind):
    """A kind of `Runs` whose spread can hold the sensor's own noise besides.

    By `draws`, white noise of sqrt(sensor_sigma^2 + sigma^2) on both scans in every noise draw of
    every setting, an upper bound, since the scans hold their own already; by `closed_form`, the
    covariance of held matches of all usable points, a lower bound, since matches and normals do not
    stay as they are.
    """

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
    def adds_closed_form(self):
        """Whether a `Covariance` comes with the runs of each start."""
        return self.sensor_sigma > 0 and self.sensor_noise_by == "closed_form"

    def returned(self, noise_draws):
        return replace(
            self.returns,
            covariances=self.adds_closed_form,
            sensor_sigma=self.sensor_sigma,
            drawn=self.drawn_sigma > 0,
            # Several draws vary what the setting's own noise does; one does not.
            together=noise_draws == 1 or not self.adds_closed_form,
        )

    @property
    def drawn_sigma(self):
        return 0.0 if self.adds_closed_form else self.sensor_sigma

    @property
    def fewest_noise_draws(self):
        return FEWEST_DRAWS if self.drawn_sigma else 1

    @property
    def made_of(self):
        added = ", and closed form of the sensor's own noise" * self.adds_closed_form
        return f"scatter of {self.runs} {self._run_of}{added}"

    @property
    def _run_of(self):
        """What its runs are of, in the plural."""
        return "ICP runs"

    def spread(self, noise_draws):
        runs = (
            "The spread of a setting is that of its runs: of where they start, of subsamples and "
        )
        runs += "of where the iteration stops"
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

    def closed_forms(self, group, reference, starts, chain, register):
        """A `Covariance` of each start: what the sensor's own noise does to all usable points.

        reference: icp.Reference; chain: icp.Chain that makes the links, of planes whatever its
        metric, since held matches of points tell nothing of how they slide along a surface;
        register(source points (m, 3), T_initial (4, 4)) -> pose, status and iterations of a run.
        """
        from icpshap import icp

        planes = replace(chain, error_minimiser=icp.PointToPlane())
        # With one noise draw the runs share the setting's noise as well, so that it is added, too.
        together = len(group.runs) == self.runs
        for same in perturb.alike(starts, "usable"):
            usable = np.flatnonzero(same[0].usable)
            points = same[0].source[usable]
            T, status, iterations = register(points, group.pair.T_reference_source)
            found = closed_form.failed(status)
            if status in GOOD_STATUS:
                of_source, of_reference = (
                    self.sensor_sigma**2 + together * variance
                    for variance in (same[0].source_variance[usable], group.reference_variance)
                )
                found = closed_form.of_clouds(reference, points, T, planes, of_source, of_reference)
            yield from found.estimates(group, same, T, iterations)
