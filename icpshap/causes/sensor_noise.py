"""White noise of the range sensor on every coordinate (paper, "Sensor Noise")."""

from dataclasses import dataclass
from typing import ClassVar

from icpshap.causes.cause import Cause
from icpshap.options import Range, option


@dataclass(frozen=True)
class SensorNoise(Cause):
    """sigma times one standard normal draw a coordinate, on both clouds."""

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

    def move(self, points, scan, level, draw, streams):
        return self._noisy(points, level, f"noise/{scan}/{draw}", streams)

    def move_again(self, points, scan, level, draw, streams):
        if scan == "reference" and self.reference_noise_additions == 2:
            return self._noisy(points, level, f"noise/reference_again/{draw}", streams)
        return points

    def _noisy(self, points, level, name, streams):
        return points + level * streams.generator(name).standard_normal(points.shape)
