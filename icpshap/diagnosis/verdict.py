"""Which causes explain what is unusual of a pair: each set of them is held against its diagnostics.

A set of causes at some levels predicts the diagnostics: the usual ones of healthy pairs, changed as
the curves of the causes say. How likely the measured ones are then is averaged over all levels, and
with what is thought of a set beforehand that makes its probability.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.diagnosis.diagnostics import NUMBERS

if TYPE_CHECKING:
    from icpshap.diagnosis.curves import Curve


# Standard deviation of the logarithms below which healthy pairs are not taken to agree: another
# place of the same kind differs by that.
FLOOR = dict(zip(NUMBERS, (0.05, 0.05, 0.05, 0.15), strict=True))
# How wrong the change is that a level makes, of itself, on another pair of the sequence. What holds
# the weak direction may be gone with its points, or not have been there: that is all the same.
MODEL = dict(zip(NUMBERS, (0.25, 0.25, 1.0, 0.25), strict=True))
# Of changes by a cause: noise makes the residual no smaller, and nothing adds overlap or points.
LIMITS = np.array([[0, -np.inf, -np.inf, -np.inf], [np.inf, 0, 0, np.inf]])
FREEDOM = 4.0  # of Student's t: healthy pairs are few, and some differ more than a normal law has
BEFORE = 0.1  # probability of a cause before anything is measured
SURE = 0.8  # probability from which on a cause is named whatever another one's is
FOUND, NOTHING, UNDECIDED, UNKNOWN = "found", "nothing", "undecided", "unknown"


class Healthy(NamedTuple):
    """Median and standard deviation (k,) of the logarithms of healthy pairs' diagnostics.

    model (k,): how wrong, of itself, a change is that a level makes on another pair.
    """

    median: np.ndarray
    deviation: np.ndarray
    model: np.ndarray

    @classmethod
    def of(cls, logarithms: np.ndarray) -> Healthy:
        """Of pairs (n, 4), some of which may be unusual."""
        median = np.median(logarithms, axis=0)
        deviation = 1.4826 * np.median(np.abs(logarithms - median), axis=0)
        deviation = np.maximum(deviation, list(FLOOR.values()))
        # The median of few has an error of its own.
        widened = deviation * np.sqrt(1 + 1.57 / len(logarithms))
        return cls(median, widened, np.array(list(MODEL.values())))

    def z(self, logarithms: np.ndarray) -> np.ndarray:
        """How many standard deviations (4,) diagnostics are above the healthy ones."""
        return (logarithms - self.median) / self.deviation


class Verdict(NamedTuple):
    """probabilities: of each cause, by name; nothing: of none; levels: of the likeliest set.

    In the causes' own units; 0 of a cause that is not in that set.
    """

    probabilities: dict[str, float]
    nothing: float
    levels: dict[str, float]

    @property
    def causes(self) -> list[str]:
        """Those in the likeliest set, the most probable first."""
        found = [name for name, level in self.levels.items() if level > 0]
        return sorted(found, key=self.probabilities.__getitem__, reverse=True)

    @property
    def said(self) -> tuple[str, list[str], float]:
        """What is said of the pair: one of the words above, causes, and how sure that is.

        FOUND has those that are found, UNDECIDED the two that cannot be told apart.
        """
        if np.isnan(self.nothing):
            return UNKNOWN, [], np.nan
        if not self.causes:
            return NOTHING, [], self.nothing
        first = self.causes[0]
        ranked = sorted(self.probabilities, key=self.probabilities.__getitem__, reverse=True)
        rival = next((name for name in ranked if name not in self.causes), None)
        if rival is None or self.probabilities[first] >= SURE:
            return FOUND, self.causes, self.probabilities[first]
        if self.probabilities[rival] > 1 - SURE:
            return UNDECIDED, [first, rival], 1 - self.nothing
        return FOUND, self.causes, self.probabilities[first]


def verdict(logarithms: np.ndarray, healthy: Healthy, curves: Mapping[str, Curve]) -> Verdict:
    """The `Verdict` on diagnostics (4,), with the `curves.Curve`s of causes by name."""
    curves = {name: curve.fine() for name, curve in curves.items()}
    found = {}
    for size in range(len(curves) + 1):
        for names in combinations(curves, size):
            found[names] = _evidence(logarithms, healthy, [curves[name] for name in names])
    weights = {
        names: np.exp(evidence) * BEFORE ** len(names) * (1 - BEFORE) ** (len(curves) - len(names))
        for names, (evidence, _) in found.items()
    }
    total = sum(weights.values())
    best = max(weights, key=weights.__getitem__)
    places = dict(zip(best, found[best][1], strict=True))
    changes = {name: curves[name].changes[place] for name, place in places.items()}
    unusual = logarithms - healthy.median
    levels = dict.fromkeys(curves, 0.0)
    for name in best:
        others = sum(change for other, change in changes.items() if other != name)
        levels[name] = curves[name].level(unusual - others)
    return Verdict(
        {
            name: sum(weight for names, weight in weights.items() if name in names) / total
            for name in curves
        },
        weights[()] / total,
        levels,
    )


def _worse(changes):
    """Changes (..., k) without what is better than usual, which is no sign of a cause.

    The weakest information may change both ways: noise blurs which direction is weak.
    """
    return np.clip(changes, *LIMITS[:, : changes.shape[-1]])


def _evidence(logarithms, healthy, curves):
    """Mean likelihood over all levels of a set of curves, as a logarithm; place of the best."""
    predicted, variance = healthy.median, healthy.deviation**2
    shape = [len(curve.levels) - 1 for curve in curves]
    for axis, curve in enumerate(curves):
        of_axis = [1] * len(curves) + [len(healthy.median)]
        of_axis[axis] = shape[axis]
        changes, spreads = curve.changes[1:], curve.spreads[1:]
        predicted = predicted + changes.reshape(of_axis)
        variance = variance + (spreads**2 + (healthy.model * changes) ** 2).reshape(of_axis)
    squares = (_worse(logarithms - healthy.median) - _worse(predicted - healthy.median)) ** 2
    squares = squares / variance
    likelihood = -0.5 * ((FREEDOM + 1) * np.log1p(squares / FREEDOM) + np.log(variance)).sum(-1)
    best = np.unravel_index(np.argmax(likelihood), shape) if curves else ()
    return np.log(np.mean(np.exp(likelihood))), [place + 1 for place in best]
