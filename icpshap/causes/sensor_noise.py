"""White noise of the range sensor on every coordinate (paper, "Sensor Noise")."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from icpshap.causes._sensors import SENSORS
from icpshap.causes.cause import Cause
from icpshap.options import Range, option


@dataclass(frozen=True)
class SensorNoise(Cause):
    """sigma times one standard normal draw a coordinate, on both clouds.

    With the model of a `sensor` sigma is that of each point's range, times the level.
    """

    name: ClassVar = "sensor_noise"
    title: ClassVar = "sensor noise"
    symbol: ClassVar = "σ"
    unit: ClassVar = "m"
    meaning: ClassVar = "Standard deviation sigma of the noise on x, y and z of both clouds"
    range: ClassVar = Range(minimum=0, maximum=100)
    colour: ClassVar = "#D55E00"
    levels: ClassVar = (0.01, 0.02, 0.05, 0.1)
    order: ClassVar = 10

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

    def __post_init__(self):
        if self.sensor != "none":  # the level is a factor
            object.__setattr__(self, "unit", "")
            object.__setattr__(self, "symbol", "σ/σ₀")

    def move(self, points, scan, level, draw, streams):
        return self._noisy(points, level, f"noise/{scan}/{draw}", streams)

    def move_again(self, points, scan, level, draw, streams):
        if scan == "reference" and self.reference_noise_additions == 2:
            return self._noisy(points, level, f"noise/reference_again/{draw}", streams)
        return points

    def noise_variance(self, points, scan, level):
        additions = self.reference_noise_additions if scan == "reference" else 1
        variance = additions * np.square(self._sigma(points, level))
        return np.broadcast_to(variance, (len(points), 1))[:, 0]

    def _noisy(self, points, level, name, streams):
        return points + self._sigma(points, level) * streams.generator(name).standard_normal(
            points.shape
        )

    def _sigma(self, points, level):
        """Standard deviation [m] of the noise of points (n, 3): a number, or (n, 1)."""
        if self.sensor == "none":
            return level
        return level * SENSORS[self.sensor].published(np.linalg.norm(points, axis=1, keepdims=True))
