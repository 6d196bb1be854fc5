"""From what is diagnosed of a pair to the game that explains it: on which pair, at which levels.

What is wrong with a pair cannot be taken out of it; it can be put into a pair that is healthy. So
the levels that were found are the instance, and it is played on the pair that they were found on:
the most usual of the others. Where there is none it is played on the pair itself, and the levels
are what would come on top of what is there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from icpshap.causes import CAUSES, named
from icpshap.diagnosis.diagnose import SHEET
from icpshap.diagnosis.verdict import FOUND, UNDECIDED, UNKNOWN
from icpshap.errors import PerturbationError
from icpshap.estimators.perturb import require_points
from icpshap.plan import Setting
from icpshap.tables import NO_PAIR, PAIR, PLAYED

if TYPE_CHECKING:
    from icpshap.data.pair import Pair
    from icpshap.estimators import Estimator, perturb


USUAL = "nothing stands out"


class Instance(NamedTuple):
    """What is explained of a pair; levels: of each cause by name, off where there is none.

    played: reference and source of the pair that it is played on; reason: why it is not, or "".
    """

    levels: dict[str, float]
    played: tuple[int, int]
    reason: str

    @property
    def columns(self) -> dict[str, Any]:
        """Those of the table `instances` that are not the pair's name."""
        played = (NO_PAIR, NO_PAIR) if self.reason else self.played
        return {
            **dict(zip(PLAYED, played, strict=True)),
            **{name: _off(name) if self.reason else level for name, level in self.levels.items()},
            "reason": self.reason,
        }


def instance(row: Any, told: Mapping[str, float]) -> Instance:
    """The `Instance` of a pair, a row (a named tuple) of the table `diagnosis`.

    told: level by name of the causes that scans do not show.
    """
    levels = {name: _found(row, name) for name in CAUSES if CAUSES[name].shown_by} | dict(told)
    levels = {cause.name: float(levels[cause.name]) for cause in named(levels)}
    other = (row.healthiest_reference, row.healthiest_source)
    played = (row.reference, row.source) if NO_PAIR in other else other
    return Instance(levels, played, _without(row))


def applied(
    found: Instance,
    load: Callable[[tuple[int, int]], Pair],
    estimator: Estimator,
    streams: perturb.Streams,
    minimum_overlap: float,
) -> Instance:
    """An `Instance` with the reason why it cannot be played, if it cannot.

    load: function of the indices of a pair to the data.pair.Pair; estimator: an
    estimators.Estimator with the causes; streams: perturb.Streams of the pair that is played on.
    """
    if found.reason:
        return found
    pair = load(found.played).for_chain(estimator.perturbing.minimum_range)
    where = "the pair {}-{} that it would be played on".format(*found.played)
    if not pair.overlap > minimum_overlap:
        few = f"the overlap ratio of {where}, {pair.overlap:.4f}, is not above {minimum_overlap}"
        return found._replace(reason=few)
    try:
        for name, level in found.levels.items():
            estimator.causes[name].check(pair, level)
        require_points(pair, Setting.at(found.levels), estimator, streams)
    except PerturbationError as error:
        said = str(error).splitlines()[0].rstrip(".")
        return found._replace(reason=f"cannot be applied to {where}: {said}")
    return found


def row_of(
    diagnosed: Any,
    told: Mapping[str, float],
    load: Callable[[tuple[int, int]], Pair],
    estimator: Estimator,
    streams: Callable[[tuple[int, int]], perturb.Streams],
    minimum_overlap: float,
) -> dict[str, Any]:
    """The row of the table `instances` of a row of the table `diagnosis`, by column.

    streams: function of the indices of a pair.
    """
    found = instance(diagnosed, told)
    found = applied(found, load, estimator, streams(found.played), minimum_overlap)
    return {**{name: getattr(diagnosed, name) for name in PAIR}, **found.columns}


def _found(row, name):
    """The level of a cause in the verdict on a pair, off where nothing is known of it."""
    level = getattr(row, f"level_{name}")
    return level if level > 0 else _off(name)


def _off(name):
    return CAUSES[name].off


def _without(row):
    """Why a pair has no instance; "" if it has one."""
    if row.verdict in (FOUND, UNDECIDED):
        return ""
    if row.verdict == UNKNOWN:
        return "not diagnosed: its scans show nothing, or there is no other pair to compare with"
    beside = "the scanner's data sheet" if row.against == SHEET else "the other pairs"
    return f"{USUAL} beside {beside}"
