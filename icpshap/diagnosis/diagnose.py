"""Diagnose pairs of scans: each against healthy ones, which are the sequence's others, or given.

Where there is none, noise alone has a healthy level: what is published of the scanner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap import causes
from icpshap.causes._sensors import SENSORS
from icpshap.diagnosis.curves import Curve, curve, mean, of_pair
from icpshap.diagnosis.diagnostics import Diagnostics
from icpshap.diagnosis.verdict import Healthy, Verdict, verdict

if TYPE_CHECKING:
    from icpshap.data.pair import Pair
    from icpshap.estimators import perturb


HEALTHIEST = 3  # pairs on which the curves are found
# What a sheet says is of one target: of others the logarithm of the residual differs by this.
OF_A_SHEET = 0.4
TIMES_PUBLISHED = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # levels that are tried then
OTHERS, SHEET, NONE = "other pairs", "data sheet", "nothing"


class Diagnosis(NamedTuple):
    """What is wrong with a pair; of a cause without a healthy level NaN.

    z: by cause, how many standard deviations of healthy pairs its diagnostic is away, positive
    where the cause would move it; verdict: `verdict.Verdict`; against: OTHERS, SHEET or NONE;
    number: of healthy pairs; healthiest: place of the most usual one, or None.
    """

    diagnostics: Diagnostics
    z: dict[str, float]
    verdict: Verdict
    against: str
    number: int
    healthiest: int | None


class Known:
    """A pair that is measured once, and its curves where they are asked for.

    load: function without arguments to the data.pair.Pair, so that the scans of a long drive need
    not be held at once; streams: perturb.Streams of the pair.
    """

    def __init__(self, load: Callable[[], Pair], streams: perturb.Streams) -> None:
        self.load, self.streams = load, streams.branched("diagnosis/")

    @cached_property
    def diagnostics(self) -> Diagnostics:
        return of_pair(self.load())

    @cached_property
    def curves(self) -> dict[str, Curve]:
        """`curves.Curve` by name of the cause."""
        pair = self.load()
        return {name: curve(name, pair, self.diagnostics, self.streams) for name in causes.shown()}


def diagnose(known: Known, others: Sequence[Known]) -> Diagnosis:
    """The `Diagnosis` of a `Known` pair against others, of which some may be unusual.

    Nothing is known of a pair whose diagnostics are not, nor beside such pairs alone.
    """
    places = [place for place, other in enumerate(others) if other.diagnostics.are_known]
    if not known.diagnostics.are_known or not places:
        return diagnose_alone(known, None)
    others = [others[place] for place in places]
    logarithms = np.array([other.diagnostics.logarithms for other in others])
    healthy = Healthy.of(logarithms)
    # The most usual ones: their curves stand for all.
    usual = np.argsort(np.abs(healthy.z(logarithms)).max(axis=1), kind="stable")[:HEALTHIEST]
    curves = {name: mean([others[k].curves[name] for k in usual]) for name in causes.shown()}
    found = verdict(known.diagnostics.logarithms, healthy, curves)
    away = healthy.z(known.diagnostics.logarithms)
    z = {name: float(away[of.own] * of.direction) for name, of in curves.items()}
    return Diagnosis(known.diagnostics, z, found, OTHERS, len(others), places[usual[0]])


def diagnose_alone(known: Known, sensor: str | None) -> Diagnosis:
    """The `Diagnosis` of a pair against what is published of a scanner, a name of `SENSORS`.

    Of noise alone: an overlap or a weak direction is unusual only beside others.
    """
    nowhere = dict.fromkeys(causes.shown(), np.nan)
    if sensor is None or not known.diagnostics.are_known:
        return Diagnosis(known.diagnostics, nowhere, _unknown(), NONE, 0, None)
    published = _published(known.load(), sensor)
    residual = known.diagnostics.logarithms[:1]
    healthy = Healthy(np.log([published]), np.array([OF_A_SHEET]), np.array([0.0]))
    levels = published * np.array([0.0, *TIMES_PUBLISHED])
    changes = 0.5 * np.log1p((levels[:, None] / published) ** 2)
    of_noise = Curve(levels, changes, np.zeros_like(changes), 0)
    found = verdict(residual, healthy, {"sensor_noise": of_noise})
    z = {**nowhere, "sensor_noise": float(healthy.z(residual)[0])}
    unknown = _unknown()
    found = Verdict(
        {**unknown.probabilities, **found.probabilities},
        found.nothing,
        {**unknown.levels, **found.levels},
    )
    return Diagnosis(known.diagnostics, z, found, SHEET, 0, None)


def _unknown():
    nowhere = dict.fromkeys(causes.shown(), np.nan)
    return Verdict(nowhere, np.nan, nowhere)


def _published(pair, sensor):
    """Median of what is published of the noise of the ranges [m] of both scans."""
    ranges = np.linalg.norm(np.concatenate([pair.reference, pair.source]), axis=1)
    return float(np.median(SENSORS[sensor].published(ranges[ranges > pair.minimum_range])))
