"""A scanner that moves while it measures a scan as if it stood still."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from icpshap.causes.cause import Cause
from icpshap.errors import PerturbationError
from icpshap.options import Range, option

if TYPE_CHECKING:
    from icpshap.causes._given import RawPair, Streams


ROTATION = 0.2  # rad for each metre: w has 0.2 d where v has d


@dataclass(frozen=True)
class MotionDistortion(Cause):
    """p becomes p + tau (w x p + v), one twist [w; v] a noise draw, on the source alone.

    tau = (t - mid) / (last - first) lies in [-1/2, 1/2]: the pose is that of mid-scan.
    w ~ N(0, (0.2 d)^2 / 3) [rad] and v ~ N(0, d^2 / 3) [m] on each axis of the scanner's frame.
    """

    name: ClassVar = "motion_distortion"
    title: ClassVar = "motion distortion"
    symbol: ClassVar = "d"
    unit: ClassVar = "m"
    meaning: ClassVar = (
        "Root d of the summed variances of the scanner's unnoticed motion during the source scan; "
        "that of the rotation is 0.2 rad for each metre"
    )
    range: ClassVar = Range(minimum=0, maximum=100)
    colour: ClassVar = "#882255"
    levels: ClassVar = (0.02, 0.05, 0.1)
    mitigation: ClassVar = "scans whose motion is taken out, or a slower drive"
    scans: ClassVar = ("source",)
    order: ClassVar = 70
    fewest_noise_draws: ClassVar = 25

    scan_order: str = option(
        "tilt",
        "When the points of a scan without times were measured. tilt: in the order of the angle of "
        "the plane through the scanner's y axis, as a tilted fan of beams; azimuth: in that of the "
        "angle about its z axis, as a spinning scanner",
        choices=("tilt", "azimuth"),
    )
    times: np.ndarray | None = field(default=None, repr=False, compare=False)

    def check(self, pair: RawPair, level: float) -> None:
        times = self.of_pair(pair)._times(pair.source)
        if times.min() == times.max():
            raise PerturbationError(
                "motion_distortion: all source points have the same "
                f"{self.scan_order if pair.source_times is None else 'time'}, expected an order in "
                "which they were measured.\n"
                "Hint: another `scan_order` of the estimator, or `time` of the sequence."
            )

    def of_pair(self, pair: RawPair) -> Self:
        """With the times (m,) of the source scan, where it has any."""
        return replace(self, times=pair.source_times)

    def move(
        self, points: np.ndarray, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        twist = streams.generator(f"twist/{draw}").standard_normal(6) / np.sqrt(3)
        w, v = ROTATION * level * twist[:3], level * twist[3:]
        return points + self._phase(points)[:, None] * (np.cross(w, points) + v)

    def _phase(self, points):
        """tau (m,) of the points (m, 3) of the raw source scan."""
        times = self._times(points)
        first, last = times.min(), times.max()
        return (times - 0.5 * (first + last)) / (last - first)

    def _times(self, points):
        """Times (m,), or what rises with them."""
        if self.times is not None:
            return self.times
        return {"tilt": _tilt, "azimuth": _azimuth}[self.scan_order](points)


def _tilt(points):
    """Angle [rad], from -pi/2 to pi/2, of the plane through the y axis and each point."""
    x, z = points[:, 0], points[:, 2]
    return np.arctan2(np.where(x < 0, z, -z), np.abs(x))


def _azimuth(points):
    """Angle [rad], from -pi to pi, about the z axis."""
    return np.arctan2(points[:, 1], points[:, 0])
