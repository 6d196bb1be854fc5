"""What each measured cause does to the diagnostics of a healthy pair: its curve, level by level.

The causes themselves act on the healthy pair, so that a level has the unit and the meaning that it
has in an experiment; only then are the diagnostics taken, as of a pair that came like this.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from icpshap.causes import CAUSES
from icpshap.causes.cause import SCANS
from icpshap.diagnosis.diagnostics import NUMBERS, WORSE, Reference, diagnostics

if TYPE_CHECKING:
    from icpshap.causes.cause import Cause
    from icpshap.data.pair import Pair
    from icpshap.diagnosis.diagnostics import Diagnostics
    from icpshap.estimators import perturb


# Levels where those that are worth trying are too few. Of the overlap they are shares of what
# there is.
LEVELS = {
    "sensor_noise": (0.005, 0.01, 0.02, 0.03, 0.05, 0.08),
    "partial_overlap": (0.35, 0.65, 0.85, 0.95),
    "under_constrained": (0.5, 0.8, 0.95, 0.99, 0.997),
}
# What is missing of a pair is missing in one direction, as behind what stands before the scanner.
OPTIONS = {"partial_overlap": {"overlap_shape": "sector"}}
AS_DIAGNOSED = {key: value for of in OPTIONS.values() for key, value in of.items()}
"""Options of an estimator with which the causes act as they do here."""
FINE = 4  # levels between two that are tried
# Times the change that the largest level makes: a pair may have less of what the cause leaves.
BEYOND = (1.25, 1.5, 2.0, 3.0, 4.0)


@dataclass(frozen=True)
class Curve:
    """levels (k,) in the cause's own unit from off on; changes and spreads (k, 4).

    changes: of the logarithms of the diagnostics, in the mean over healthy pairs; spreads: their
    standard deviation over these; own: place of the diagnostic that is the cause's own.
    """

    levels: np.ndarray
    changes: np.ndarray
    spreads: np.ndarray
    own: int

    def fine(self) -> Curve:
        """The same with levels in between, and with more of the cause's own change at the last."""
        known = np.arange(len(self.levels))
        places = np.linspace(0, known[-1], FINE * known[-1] + 1)
        levels, changes, spreads = (
            np.stack([np.interp(places, known, column) for column in of.T], axis=1)
            for of in (self.levels[:, None], self.changes, self.spreads)
        )
        more = np.repeat(changes[-1:], len(BEYOND), axis=0)
        more[:, self.own] *= BEYOND
        return Curve(
            np.append(levels[:, 0], np.repeat(levels[-1], len(BEYOND))),
            np.vstack([changes, more]),
            np.vstack([spreads, np.repeat(spreads[-1:], len(BEYOND), axis=0)]),
            self.own,
        )

    @property
    def direction(self) -> int:
        """1 where the cause's own diagnostic is worse if it is larger, -1 if it is smaller."""
        return WORSE[self.own]

    def level(self, change: np.ndarray) -> float:
        """The level at which the cause's own diagnostic changes as in `change` (4,); not off."""
        grown = np.maximum.accumulate(self.direction * self.changes[:, self.own])
        level = np.interp(self.direction * change[self.own], grown, self.levels)
        return float(max(level, self.levels[1]))


def curve(name: str, pair: Pair, healthy: Diagnostics, streams: perturb.Streams) -> Curve:
    """The `Curve` of a cause on a data.pair.Pair, of which `healthy` are the `Diagnostics`."""
    cause = CAUSES[name](**OPTIONS.get(name, {}))
    scale = pair.overlap if name == "partial_overlap" else 1.0
    levels = scale * np.array([0.0, *LEVELS.get(name, cause.levels)])
    changes = np.zeros((len(levels), len(NUMBERS)))
    untouched = None if "reference" in cause.scans else reference_of(pair)
    for place, level in enumerate(levels[1:], 1):
        changed = of_pair(perturbed(cause, pair, level, streams), untouched)
        changes[place] = changed.logarithms - healthy.logarithms
    return Curve(levels, changes, np.zeros_like(changes), NUMBERS.index(cause.shown_by))


def mean(curves: Sequence[Curve]) -> Curve:
    """The mean of the curves of one cause on several pairs: places and drawn sectors differ."""
    levels, changes = (np.array([getattr(c, of) for c in curves]) for of in ("levels", "changes"))
    return Curve(levels.mean(axis=0), changes.mean(axis=0), changes.std(axis=0), curves[0].own)


def perturbed(cause: Cause, pair: Pair, level: float, streams: perturb.Streams) -> Pair:
    """A data.pair.Pair as a cause leaves it, through the hook by which it acts on scans."""
    points = {scan: getattr(pair, scan) for scan in SCANS}
    for scan in cause.scans:
        if cause.hook() == "move":
            points[scan] = cause.move(points[scan], scan, level, 0, streams)
        else:
            points[scan] = points[scan][cause.keep(pair, scan, level, 0, streams)]
    overlapping = np.empty(0, dtype=bool)  # that of the pair no longer; diagnostics measure it
    return replace(pair, **points, overlapping=overlapping, source_times=None)


def of_pair(pair: Pair, reference: Reference | None = None) -> Diagnostics:
    """The `Diagnostics` of a data.pair.Pair; reference: its `Reference`, where it is known."""
    return diagnostics(
        reference_of(pair) if reference is None else reference,
        pair.source,
        pair.T_reference_source,
        pair.minimum_range,
        pair.overlap_distance,
    )


def reference_of(pair: Pair) -> Reference:
    """The `Reference` of a data.pair.Pair."""
    return Reference.of(pair.reference, pair.minimum_range)
