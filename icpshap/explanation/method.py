"""How estimates become numbers: the options of reading f and its interval."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from icpshap.explanation import readings
from icpshap.options import option


@dataclass(frozen=True)
class Method:
    """Options of every estimator; `seed` is that of the bootstrap."""

    covariance_floor_rotation: float = option(
        1e-6,
        "Added to every rotation standard deviation, in squares",
        unit="rad",
        minimum=0,
        maximum=10,
    )
    covariance_floor_translation: float = option(
        1e-6,
        "Added to every translation standard deviation, in squares",
        unit="m",
        minimum=0,
        maximum=1e4,
    )
    divergence: str = option(
        "kl", 'The reading of "uncertainty" f', choices=tuple(readings.READINGS)
    )
    bias_correction: str = option(
        "none",
        "Correction of f for the finite number of runs; wishart needs independent samples",
        choices=("none", "jackknife", "wishart"),
    )
    wrong_basins: str = option(
        "keep",
        "Whether runs in a wrong basin are kept in the covariances or left out",
        choices=("keep", "leave_out"),
    )
    wrong_basin_translation: float = option(
        0.1,
        "Further than this from the setting's centre, and outside its own bulk, is a wrong basin",
        unit="m",
        above=0,
        maximum=1e6,
    )
    wrong_basin_rotation: float = option(
        2.0,
        "Further than this from the setting's centre, and outside its own bulk, is a wrong basin",
        unit="deg",
        above=0,
        maximum=360,
    )
    interval: str = option(
        "jackknife",
        "How the 95 % intervals are made from the runs",
        choices=("jackknife", "bootstrap"),
    )
    seed: int = 0

    @property
    def reading(self) -> readings.Reading:
        return readings.READINGS[self.divergence]

    @property
    def of_covariances(self) -> Method:
        """The same for what is read off covariances, in which failed runs never count."""
        return self if self.reading.compares_with_clean else replace(self, divergence="kl")

    @property
    def of_errors(self) -> Method:
        """The same for squared errors, which need no covariance."""
        return replace(self, divergence="translation_rmse")

    @property
    def floor(self) -> tuple[float, float]:
        return self.covariance_floor_rotation, self.covariance_floor_translation

    @property
    def basin(self) -> tuple[float, float]:
        """Limits of the basin: translation [m] and rotation [rad]."""
        return self.wrong_basin_translation, np.deg2rad(self.wrong_basin_rotation)

    @property
    def leaves_out_wrong_basins(self) -> bool:
        return self.wrong_basins == "leave_out"

    def with_floor(self, factor: float) -> Method:
        """The same with `factor` times the covariance floor (as a standard deviation)."""
        rotation, translation = (factor * floor for floor in self.floor)
        return replace(
            self, covariance_floor_rotation=rotation, covariance_floor_translation=translation
        )
