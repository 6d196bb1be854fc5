"""What is explained where instances are diagnosed: what was found, where it is played, what to do.

Tables are shap tables and tables of `diagnosis.table`, and studies `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tabulate import tabulate

from icpshap.diagnosis.here import USUAL
from icpshap.diagnosis.verdict import UNDECIDED
from icpshap.report import diagnosis, words
from icpshap.report.study import pairs_of
from icpshap.tables import NO_PAIR, PAIR, PLAYED

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.causes.cause import Cause
    from icpshap.report.study import Study


FEW_PAIRS = 4  # are named one by one
NEW_SCANS = "that needs new scans"
SAME_SCANS = "that can be tried on these scans"
NOTE = (
    "What was found in a pair was put into the pair that it is played on, where it can be taken "
    "out again: without a cause f falls by the number beside it, most first, with its 95 % "
    "interval. What the pair itself would gain is predicted by that, and was not tried."
)


def instances(table: pd.DataFrame, study: Study) -> str:
    """At which levels pairs are explained, and on which pairs, after their names."""
    told = [cause for cause in study.shown(table) if cause.told]
    played = table[table.reason == ""]
    also = f" and {words.describe_values(played.iloc[0], told)}" if told else ""
    return f"at the diagnosed levels{also}{_where(table, study)}"


def _where(table, study):
    """On which pairs the instances are played, with a comma; "" where none is."""
    if not set(PLAYED) <= set(table):
        return ""
    rows = pairs_of(table[table.played_reference != NO_PAIR])
    own = (rows.played_reference == rows.reference) & (rows.played_source == rows.source)
    others = dict.fromkeys(study.run_pair(row) for row in rows[~own].itertuples())
    on = []
    if others:
        which = "its" if len(others) > 1 else "the"
        named = f" ({', '.join(others)})" * (len(others) <= FEW_PAIRS)
        on.append(f"on {which} most usual other pair{named}")
    if own.any():
        on.append("on the pair itself, on top of what is there")
    return f", played {' or '.join(on)}" if on else ""


def nothing(table: pd.DataFrame) -> str:
    """That there is nothing to explain, where no pair stands out; "" else."""
    usual = bool(table.reason.str.startswith(USUAL).all())
    return "nothing stands out in any pair, so that there is nothing to explain" * usual


def advice(table: pd.DataFrame, study: Study) -> list[str]:
    """What to do: of each cause that some pairs' f falls most without, these pairs; sentences."""
    found: dict[Cause, list[Any]] = {}
    unclear = []
    for row in study.valued(table).itertuples():
        # Less of what narrows the spread makes no error smaller.
        best = [c for c in _by_removal(row, study) if not getattr(row, f"narrows_{c.name}")][:1]
        if best and getattr(row, f"removal_{best[0].name}_low") > 0:
            found.setdefault(best[0], []).append(row)
        else:
            unclear.append(row)
    told = [
        f"f of {_named(rows, study)} falls most without {cause.title}. What may lower it (not "
        f"tried): {cause.mitigation}; {SAME_SCANS if cause.told else NEW_SCANS}, and its effect is "
        f"predicted, from the game on {_named(rows, study, study.run_pair)}."
        for cause, rows in found.items()
    ]
    if unclear:
        told.append(
            f"Of {_named(unclear, study)} no removal can be told from zero: what was found there "
            "need not make the registration uncertain."
        )
    return told


def _by_removal(row, study):
    """The causes that are on in a row, by falling removal effect."""
    on = [cause for cause in study.players if getattr(row, cause.name) != cause.off]
    return sorted(on, key=lambda cause: -getattr(row, f"removal_{cause.name}"))


def _named(rows, study, name=None):
    names = list(dict.fromkeys(map(name or study.pair, rows)))
    return words.listed(names) if len(names) <= FEW_PAIRS else f"{len(names)} pairs"


def html(table: pd.DataFrame, diagnoses: pd.DataFrame, study: Study) -> str:
    """Of each pair with an instance what was found, where it is played, and what removals bring."""
    diagnosed = {tuple(getattr(row, name) for name in PAIR): row for row in diagnoses.itertuples()}
    body = [
        [
            study.pair(row),
            _found(diagnosed[tuple(getattr(row, name) for name in PAIR)]),
            study.run_pair(row),
            words.with_interval(row.f, row.f_low, row.f_high),
            "; ".join(_removal(row, cause) for cause in _by_removal(row, study)),
        ]
        for row in study.valued(table).itertuples()
    ]
    if not body:
        return ""
    header = [
        "pair",
        "found",
        "played on",
        f"f [{study.unit}]",
        f"falls by, without [{study.unit}]",
    ]
    return tabulate(body, header, tablefmt="html", disable_numparse=True)


def _found(row):
    either = row.verdict == UNDECIDED
    return f"{diagnosis.short(row)}{', of which the first is played' * either}"


def _removal(row, cause):
    name = f"removal_{cause.name}"
    value = words.with_interval(*(getattr(row, f"{name}{end}") for end in ("", "_low", "_high")))
    return f"{cause.title} {value}"
