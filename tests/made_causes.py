"""Causes made for the tests, one through each hook: a file to be put into `icpshap/causes/`."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from icpshap.causes.cause import Cause
from icpshap.options import Range


@dataclass(frozen=True)
class Rounding(Cause):
    """Coordinates are rounded to a step, the last thing that the scanner does."""

    name: ClassVar = "rounding"
    title: ClassVar = "rounding"
    symbol: ClassVar = "δ"
    unit: ClassVar = "m"
    meaning: ClassVar = "Step to which coordinates are rounded"
    colour: ClassVar = "#CC79A7"
    levels: ClassVar = (0.01, 0.05)
    order: ClassVar = 5

    def move(self, points, scan, level, draw, streams):
        return np.round(points / level) * level if level else points


@dataclass(frozen=True)
class BlindSide(Cause):
    """Points of both scans in the darker part of a random direction are lost."""

    name: ClassVar = "blind_side"
    title: ClassVar = "blind side"
    symbol: ClassVar = "β"
    meaning: ClassVar = "Share of the points of both scans that are lost on one side"
    range: ClassVar = Range(minimum=0, below=1)
    colour: ClassVar = "#E69F00"
    levels: ClassVar = (0.1, 0.3)

    def keep(self, pair, scan, level, draw, streams):
        points = getattr(pair, scan)
        direction = streams.generator("blind_side").standard_normal(3)
        along = points @ direction
        return along >= np.quantile(along, level) if level else np.ones(len(points), dtype=bool)


@dataclass(frozen=True)
class FewerPoints(Cause):
    """A run uses fewer of its points."""

    name: ClassVar = "fewer_points"
    title: ClassVar = "fewer points"
    symbol: ClassVar = "ρ"
    meaning: ClassVar = "Factor by which the points of a run are fewer"
    off: ClassVar = 1.0
    range: ClassVar = Range(minimum=1)
    colour: ClassVar = "#56B4E9"
    levels: ClassVar = (2.0, 4.0)

    def thin(self, rows, run, level, count, streams):
        luck = streams.generator(f"fewer_points/{run}").random(count)
        return rows[luck[rows] <= 1 / level]


@dataclass(frozen=True)
class Offset(Cause):
    """The source alone is measured with an offset, the same for all points of a noise draw."""

    name: ClassVar = "offset"
    title: ClassVar = "offset of the source"
    symbol: ClassVar = "o"
    unit: ClassVar = "m"
    meaning: ClassVar = "Standard deviation of the offset of the source"
    colour: ClassVar = "#000000"
    levels: ClassVar = (0.02, 0.05)
    scans: ClassVar = ("source",)

    def move(self, points, scan, level, draw, streams):
        return points + level * streams.generator(f"offset/{draw}").standard_normal(3)
