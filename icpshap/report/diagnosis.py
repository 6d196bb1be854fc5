"""What is wrong with pairs of scans, in words; tables are those of `diagnosis.table`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from tabulate import tabulate

from icpshap import causes
from icpshap.diagnosis.diagnose import NONE, OTHERS, SHEET
from icpshap.diagnosis.verdict import FLOOR, FOUND, NOTHING, UNDECIDED, UNKNOWN
from icpshap.report import words
from icpshap.report.study import pairs_of
from icpshap.tables import PAIR

if TYPE_CHECKING:
    from icpshap.report.study import Study


LOST = "clean runs in a wrong basin"
ENOUGH = 8  # healthy pairs from which on they say how much what is usual varies


def sentence(row: Any) -> str:
    """The verdict on a pair, a row (a named tuple) of the table, with its confidence."""
    beside = {
        OTHERS: f"Beside {row.healthy_pairs} other pair{'s' * (row.healthy_pairs > 1)}",
        NONE: "With no other pair",
    }.get(row.against, "Beside the scanner's data sheet")
    if np.isnan(row.weakest_information):
        return (
            "The scans hardly overlap at the pose, or show no planes: nothing can be measured in "
            "them."
        )
    sure = f"probability {probability(row.confidence)}"
    if row.verdict == NOTHING:
        what = "the noise does not stand out" if row.against == SHEET else "nothing stands out"
        return f"{beside} {what} ({sure})."
    names = row.causes.split(", ") if row.causes else []
    if row.verdict == UNDECIDED:
        both = words.listed(words.titles(names))
        return f"{beside} {both} cannot be told apart; one of them stands out ({sure})."
    if row.verdict == FOUND:
        found = [_found(name, row) for name in names]
        return f"{beside} {words.listed(found)} stand{'s' * (len(names) == 1)} out ({sure})."
    return (
        f"{beside} or scanner to be held against, nothing can be called unusual: give healthy pairs"
        " of the same scanner in the same kind of place, or name the scanner."
    )


def probability(value: float) -> str:
    """That of a verdict: none is certain."""
    return "above 0.99" if value > 0.99 else f"{value:.2f}"


def doubts(row: Any) -> str:
    """What the pairs that a pair is held against do not say, "" of nothing."""
    if row.against == SHEET:
        return "A data sheet says something of noise alone, and nothing of overlap and directions."
    if row.against == OTHERS and row.healthy_pairs < ENOUGH:
        return (
            f"Fewer than {ENOUGH} other pairs hardly say how much what is usual varies: standard "
            f"deviations are of at least {_assumed()}, which is assumed."
        )
    return ""


def _assumed():
    """The least standard deviations that healthy pairs are taken to have."""
    weakest = "weakest_information"
    others = {f"{100 * least:g} %" for name, least in FLOOR.items() if name != weakest}
    return f"{words.listed(sorted(others))} ({100 * FLOOR[weakest]:g} % of the weakest information)"


def _found(name, row):
    cause = causes.CAUSES[name]()
    level = getattr(row, f"level_{name}")
    at = f"{cause.symbol} = {words.significant(level)} {cause.unit}".strip()
    return f"{cause.title} ({at}, {getattr(row, f'z_{name}'):+.1f} standard deviations)"


def weakest(row: Any) -> str:
    """The direction of the pose that a pair holds least."""
    share = words.significant(100 * row.weakest_information)
    return f"Weakest direction: {row.weakest}, with {share} % of the information (16.7 % is even)."


def unseen() -> str:
    """Which causes no scan shows, and why they are not in a verdict."""
    known = causes.CAUSES.values()
    told = words.listed([cause.title for cause in known if cause.told])
    hidden = words.listed([c.title for c in known if not (c.told or c.shown_by)])
    return (
        f"Told by the configuration, not measured: {told}. Not visible in scans: {hidden}. A pair "
        "is held against others: what all of them have is not seen, and pairs of another kind of "
        "place mislead. What stands out need not make the registration uncertain."
    )


def summary(table: pd.DataFrame, pair_name: Callable[[Any], str]) -> str:
    """How many pairs of a table stand out, and by what; pair_name: words of a row's pair."""
    if len(table) == 1:
        return sentence(next(table.itertuples()))
    named = table[table.verdict.isin([FOUND, UNDECIDED])]
    unknown = int((table.verdict == UNKNOWN).sum())
    if unknown == len(table):
        return sentence(next(table.itertuples()))
    left_out = f" Of {unknown} more nothing can be said." if unknown else ""
    known = len(table) - unknown
    if named.empty:
        return f"Nothing stands out in any of {known} pairs, each beside the others.{left_out}"
    parts = [f"{pair_name(row)}: {short(row)}" for row in named.itertuples()]
    return (
        f"Of {known} pairs {len(named)} stand{'s' * (len(named) == 1)} out beside the others: "
        f"{'; '.join(parts)}.{left_out}"
    )


def short(row: Any) -> str:
    """What was found of a pair, with its levels."""
    names = row.causes.split(", ")
    if row.verdict == UNDECIDED:
        return " or ".join(words.titles(names))
    return words.listed([_found(name, row) for name in names])


def html(table: pd.DataFrame, shaps: Mapping[str, pd.DataFrame], study: Study) -> str:
    """What was found of each pair, as an HTML table; cells: standard deviations from the others.

    shaps: shap tables of the same pairs, by the experiment's name: each knows where its clean runs
    end.
    """
    names = causes.shown()
    lost = _lost(table, shaps)
    rows = [
        [
            study.pair(row),
            *(_standing(getattr(row, f"z_{name}")) for name in names),
            short(row) if row.verdict in (FOUND, UNDECIDED) else row.verdict,
            "" if np.isnan(row.confidence) else probability(row.confidence),
            *shares,
        ]
        for row, *shares in zip(table.itertuples(), *lost.values(), strict=True)
    ]
    deviations = [f"{title}, deviations" for title in words.titles(names)]
    header = ["pair", *deviations, "verdict", "probability", *lost]
    return tabulate(rows, header, tablefmt="html", disable_numparse=True)


def _lost(table, shaps):
    """Columns by title: the share of clean runs in a wrong basin of each pair of a table.

    One of all experiments of which it is the same.
    """
    columns: dict[tuple, list[str]] = {}
    for name, shap in shaps.items():
        of_pair = pairs_of(shap).set_index(PAIR).clean_wrong_basin_share
        shares = of_pair.reindex(pd.MultiIndex.from_frame(table[PAIR]))
        columns.setdefault(tuple(map(_share, shares)), []).append(name)
    return {
        LOST + f", {', '.join(together)}" * (len(columns) > 1): cells
        for cells, together in columns.items()
    }


def _share(value):
    return "" if np.isnan(value) else f"{value:.0%}"


def _standing(z):
    return "" if np.isnan(z) else f"{z:+.1f}"
