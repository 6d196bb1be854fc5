"""What is played of each pair of a sequence: on which pair, at which levels, or why nothing is.

The levels are those of the plan and the pair its own, unless instances are diagnosed: then the
table `instances` says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from icpshap import plan, tables
from icpshap.explanation.scan_pair import ScanPair
from icpshap.jobs import plans
from icpshap.tables import NO_PAIR, PLAYED

if TYPE_CHECKING:
    import pandas as pd


class Game(NamedTuple):
    """What is played of a pair (reference, source), or the reason why nothing is.

    levels: of each cause by name; run: the pair that is run, None of no game.
    """

    pair: tuple[int, int]
    levels: dict
    run: tuple[int, int] | None
    reason: str

    def settings(self, part: plan.Part, replicates: int) -> list[plan.Setting]:
        """The plan.Setting of a plan.Part; none where it was cut for levels that turned out off."""
        return plan.settings(self.levels, replicates)[part.start : part.stop] if self.run else []


def games(
    pairs: pd.DataFrame, planned: Mapping[str, Any], instances: Sequence[str | Path]
) -> dict[tuple[int, int], Game]:
    """The `Game` of each pair of a pairs table, by pair.

    planned: the plan of the file that is made; instances: path of the table, whose plan's digest is
    in it, in a list, which is empty where they are not diagnosed. Raises TableError for the table
    of another plan.
    """
    if not instances:
        return {
            pair: Game(pair, planned["levels"], None if row.reason else pair, row.reason)
            for pair, row in by_pair(pairs).items()
        }
    (path,) = instances
    plans.check(path, planned["instances"])
    found = by_pair(tables.read(path, "instances"))
    causes = [*planned["levels"], *planned["measured"]]
    return {pair: _diagnosed(pair, found[pair], causes) for pair in by_pair(pairs)}


def described(pairs: pd.DataFrame, games: Mapping[tuple[int, int], Game]) -> pd.DataFrame:
    """A pairs table with what is played of each pair: whether it is, and why not."""
    reasons = [game.reason for game in games.values()]
    return pairs.assign(reason=reasons, registered=[not reason for reason in reasons])


def scan_pair(
    game: Game, rows: Mapping[tuple[int, int], Any], planned: Mapping[str, Any]
) -> ScanPair:
    """What an explanation knows of the pair that is run, under the name of that of the game.

    rows: of the pairs table, as `by_pair` has them.
    """
    if not tables.is_here(planned):
        return ScanPair.of(rows[game.pair])
    if game.run is None:
        return replace(ScanPair.of(rows[game.pair]), played=(NO_PAIR, NO_PAIR))
    return ScanPair.of(rows[game.run]).standing_for(game.pair)


def as_run(table: pd.DataFrame, planned: Mapping[str, Any]) -> pd.DataFrame:
    """A table under the indices of the pairs that were run, not of those that are explained."""
    if not tables.is_here(planned):
        return table
    own = zip(("reference", "source"), PLAYED, strict=True)
    return table.assign(**{name: table[played] for name, played in own})


def by_pair(table: pd.DataFrame) -> dict[tuple[int, int], Any]:
    """Rows of a table that has one of each pair, by pair (reference, source)."""
    return {(row.reference, row.source): row for row in table.itertuples()}


def _diagnosed(pair, row, causes):
    run = None if row.reason else tuple(getattr(row, name) for name in PLAYED)
    return Game(pair, {name: (getattr(row, name),) for name in causes}, run, row.reason)
