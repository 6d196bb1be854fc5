"""What each measured cause does to the diagnostics of a healthy pair: its curve, level by level.

The causes themselves act on the healthy pair, so that a level has the unit and the meaning that it
has in an experiment; only then are the diagnostics taken, as of a pair that came like this.
"""

from dataclasses import dataclass, replace

import numpy as np

from icpshap.causes import CAUSES
from icpshap.causes.cause import SCANS
from icpshap.diagnosis.diagnostics import NUMBERS, diagnostics

DRAWS = 3  # of a cause that is another one in each
# Levels of the causes that scans show. Of the overlap they are shares of what there is.
LEVELS = {
    "sensor_noise": (0.005, 0.01, 0.014, 0.02, 0.028, 0.04, 0.057, 0.08),
    "partial_overlap": (0.25, 0.5, 0.75, 0.875, 0.95),
    "under_constrained": (0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.997),
}
# What is missing of a pair is missing in one direction, as behind what stands before the scanner.
OPTIONS = {"partial_overlap": {"overlap_shape": "sector"}}
FINE = 4  # levels between two that are tried


@dataclass(frozen=True)
class Curve:
    """levels (k,) in the cause's own unit from off on; changes and spreads (k, 4).

    changes: of the logarithms of the diagnostics, in the mean over the draws; spreads: their
    standard deviation over the draws; own: place of the diagnostic that is the cause's own.
    """

    levels: np.ndarray
    changes: np.ndarray
    spreads: np.ndarray
    own: int

    def fine(self):
        """The same with levels in between."""
        known = np.arange(len(self.levels))
        places = np.linspace(0, known[-1], FINE * known[-1] + 1)
        columns = [
            np.stack([np.interp(places, known, column) for column in of.T], axis=1)
            for of in (self.changes, self.spreads)
        ]
        return Curve(np.interp(places, known, self.levels), *columns, self.own)

    @property
    def direction(self):
        """1 where the cause's own diagnostic grows with its level, -1 where it falls."""
        return np.sign(self.changes[-1, self.own])

    def level(self, change):
        """The level at which the cause's own diagnostic changes as in `change` (4,); not off."""
        grown = np.maximum.accumulate(self.direction * self.changes[:, self.own])
        level = np.interp(self.direction * change[self.own], grown, self.levels)
        return float(max(level, self.levels[1]))


def curve(name, pair, healthy, streams):
    """The `Curve` of a cause on a data.pair.Pair, of which `healthy` are the `Diagnostics`."""
    cause = CAUSES[name](**OPTIONS.get(name, {}))
    scale = pair.overlap if name == "partial_overlap" else 1.0
    levels = scale * np.array([0.0, *LEVELS[name]])
    draws = range(DRAWS if cause.hook() == "keep" and cause.drawn else 1)
    changes = np.zeros((len(levels), len(draws), len(NUMBERS)))
    for place, level in enumerate(levels[1:], 1):
        for draw in draws:
            changed = _diagnostics(perturbed(cause, pair, level, draw, streams))
            changes[place, draw] = changed.logarithms - healthy.logarithms
    own = NUMBERS.index(cause.shown_by)
    return Curve(levels, changes.mean(axis=1), changes.std(axis=1), own)


def perturbed(cause, pair, level, draw, streams):
    """A data.pair.Pair as a cause leaves it, through the hook by which it acts on scans."""
    points = {scan: getattr(pair, scan) for scan in SCANS}
    for scan in cause.scans:
        if cause.hook() == "move":
            points[scan] = cause.move(points[scan], scan, level, draw, streams)
        else:
            points[scan] = points[scan][cause.keep(pair, scan, level, draw, streams)]
    return replace(pair, **points, overlapping=None, source_times=None)


def of_pair(pair):
    """The `Diagnostics` of a data.pair.Pair."""
    return _diagnostics(pair)


def _diagnostics(pair):
    return diagnostics(
        pair.reference,
        pair.source,
        pair.T_reference_source,
        pair.minimum_range,
        pair.overlap_distance,
    )
