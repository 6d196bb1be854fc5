"""White noise of the range sensor on every coordinate (paper, "Sensor Noise")."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from icpshap.causes._sensors import SENSORS
from icpshap.causes.cause import Cause
from icpshap.options import Range, option

if TYPE_CHECKING:
    from icpshap.causes._given import Streams


@dataclass(frozen=True)
class SensorNoise(Cause):
    """sigma times one standard normal draw a coordinate, on both clouds.

    With the model of a `sensor` sigma is that of each point's range, times the level. own [m]: the
    sensor's own noise, which an estimator may want drawn in every setting: white noise of
    sqrt(own^2 + sigma^2) from the same draw.
    """

    name: ClassVar = "sensor_noise"
    title: ClassVar = "sensor noise"
    symbol: ClassVar = "σ"
    unit: ClassVar = "m"
    meaning: ClassVar = "Standard deviation sigma of the noise on x, y and z of both clouds"
    range: ClassVar = Range(minimum=0, maximum=100)
    colour: ClassVar = "#D55E00"
    levels: ClassVar = (0.01, 0.02, 0.05, 0.1)
    mitigation: ClassVar = "a more exact scanner, or points averaged on a grid"
    order: ClassVar = 10
    shown_by: ClassVar = "plane_residual"

    reference_noise_additions: int = option(
        1,
        "Times that sensor noise is added to the reference; the released code does it twice",
        unit="-",
        minimum=1,
        maximum=2,
    )
    sensor: str = option(
        "none",
        "Scanner of which sensor noise has the published standard deviation, or accuracy, at each "
        "point's range, times the level; none: the level is the standard deviation of all points",
        choices=("none", *SENSORS),
        variant=True,
    )

    own: float = 0.0

    @property
    def acts_when_off(self) -> bool:
        return self.own > 0

    @property
    def adds_evenly(self) -> bool:
        return self.sensor == "none" and self.reference_noise_additions == 1

    def __post_init__(self) -> None:
        if self.sensor != "none":  # the level is a factor
            object.__setattr__(self, "unit", "")
            object.__setattr__(self, "symbol", "σ/σ₀")

    def with_own_noise(self, sigma: float) -> Self:
        return replace(self, own=sigma)

    def move(
        self, points: np.ndarray, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        return self._noisy(points, level, f"noise/{scan}/{draw}", streams)

    def move_again(
        self, points: np.ndarray, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        if scan == "reference" and self.reference_noise_additions == 2 and level:
            # The sensor's own noise is there once.
            return replace(self, own=0.0)._noisy(
                points, level, f"noise/reference_again/{draw}", streams
            )
        return points

    def noise_variance(self, points: np.ndarray, scan: str, level: float) -> np.ndarray:
        additions = self.reference_noise_additions if scan == "reference" else 1
        variance = additions * np.square(replace(self, own=0.0)._sigma(points, level))
        variance = variance + self.own**2
        return np.broadcast_to(variance, (len(points), 1))[:, 0]

    def _noisy(self, points, level, name, streams):
        return points + self._sigma(points, level) * streams.generator(name).standard_normal(
            points.shape
        )

    def _sigma(self, points, level):
        """Standard deviation [m] of the noise of points (n, 3): a number, or (n, 1)."""
        sigma = level
        if self.sensor != "none":
            published = SENSORS[self.sensor].published
            sigma = level * published(np.linalg.norm(points, axis=1, keepdims=True))
        return np.hypot(self.own, sigma) if self.own else sigma
