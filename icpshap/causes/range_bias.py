"""Ranges that are all wrong by the same amount (paper, "Sensor noise": sensor bias noise)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap.causes.cause import Cause
from icpshap.options import Range

if TYPE_CHECKING:
    from icpshap.causes._given import Streams


@dataclass(frozen=True)
class RangeBias(Cause):
    """Every point of a scan is moved along its ray by b g, one g ~ N(0, 1) a scan and noise draw.

    The scanner stands at the origin; a point there has no ray and stays.
    """

    name: ClassVar = "range_bias"
    title: ClassVar = "range bias"
    symbol: ClassVar = "b"
    unit: ClassVar = "m"
    meaning: ClassVar = "Standard deviation b of an error that all ranges of a scan share"
    range: ClassVar = Range(minimum=0, maximum=100)
    colour: ClassVar = "#56B4E9"
    levels: ClassVar = (0.01, 0.03, 0.05)
    mitigation: ClassVar = "calibrated ranges"
    order: ClassVar = 60
    fewest_noise_draws: ClassVar = 25

    def move(
        self, points: np.ndarray, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        ranges = np.linalg.norm(points, axis=1, keepdims=True)
        rays = points / np.where(ranges > 0, ranges, 1.0)
        return points + level * streams.generator(f"bias/{scan}/{draw}").standard_normal() * rays
