"""What makes numbers doubtful, in words: kinds of doubts, the gravest first, each with what to do.

Tables are shap tables, and studies `study.Study`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.diagnosis.here import USUAL
from icpshap.report import words
from icpshap.report.study import pairs_of

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.report.study import Study


FEW_PAIRS = 4  # are named one by one


class Kind(NamedTuple):
    """A kind of doubts: its title, what to do, and what a remark of the tables that is one says."""

    title: str
    advice: str
    marks: tuple = ()


class Doubt(NamedTuple):
    """One doubt in words, and the name of its kind."""

    kind: str
    text: str


class Group(NamedTuple):
    """The doubts of a kind: its title, what to do, and (scope, text) of each."""

    title: str
    advice: str
    lines: list


KINDS = {
    "truth": Kind(
        "The true pose looks wrong",
        "Look at the scene and correct the poses; believe no number before.",
        ("ground truth looks wrong",),
    ),
    "no_value": Kind(
        "No value",
        "Take more runs, or milder levels of the causes; where pose samples are needed, an "
        "estimator that returns some.",
        ("needs pose samples", "runs left", "noise draws left"),
    ),
    "not_registered": Kind(
        "Pairs that were not registered",
        "Choose scans that overlap more; minimum_overlap says how much is demanded.",
    ),
    "not_explained": Kind(
        "Pairs of which nothing is explained",
        "Give the sequence more pairs of the same kind of place, or the pair an experiment with "
        "fixed levels.",
    ),
    "unconverged": Kind(
        "The clean spread shows where the iteration stops",
        "Let the registration stop later (stop_rotation, stop_translation where it has them).",
        ("the initial pose explains",),
    ),
    "floor": Kind(
        "The clean spread is hardly more than the covariance floor",
        "Draw the subsample of each run anew (subsampling_mask), or give the sensor's own noise.",
        ("of the clean variance in one direction",),
    ),
    "few_decide": Kind(
        "A few runs make up the covariance",
        "Take more runs, or the estimator robust, which leaves out those in a wrong basin.",
        ("more than Gaussian ones would",),
    ),
    "basins": Kind(
        "Wrong basins: results far from where most others end",
        "See in the scene where they end; a closer start, more points (subsampling_probability) or "
        "normals from more neighbours have fewer; `wrong_basins` says whether f counts them.",
        ("another basin", "never in a wrong basin"),
    ),
    "failed": Kind(
        "Runs that failed",
        "Take more points (subsampling_probability) or milder levels of the causes.",
    ),
    "intervals": Kind(
        "No intervals",
        "Take more noise draws (noise_draws).",
        ("no interval",),
    ),
    "counting": Kind(
        "The overlap ratio is above 1",
        "Make the scan with more points the reference, or thin the source.",
        ("the overlap ratio is",),
    ),
    "other": Kind("Other remarks", ""),
}


def kind_of(remark: str) -> str:
    """Name of the kind of a remark of the tables."""
    known = (name for name, kind in KINDS.items() if any(mark in remark for mark in kind.marks))
    return next(known, "other")


def warnings(table: pd.DataFrame, study: Study) -> list[str]:
    """The texts of all doubts about a table, the gravest first."""
    return [doubt.text for doubt in of_table(table, study)]


def of_table(table: pd.DataFrame, study: Study) -> list[Doubt]:
    """The `Doubt`s about a table, the gravest first."""
    found = [
        *_not_registered(table, study),
        *_remarks(table, study),
        *_floor_sensitivity(table, study),
        *_unsettled(table, study),
        *_basins(table, study),
        *_left_out(table, study),
    ]
    return sorted(found, key=lambda doubt: list(KINDS).index(doubt.kind))


def of_pairs(pairs: pd.DataFrame, study: Study) -> list[Doubt]:
    """The `Doubt`s about the pairs of a pairs table, a remark on several of them once."""
    return [
        Doubt(kind_of(remark), f"{_where(rows, study)}: {remark.rstrip('.')}.")
        for remark, rows in _by_remark(pairs)
    ]


def grouped(doubts: Iterable[tuple[str, Doubt]]) -> list[Group]:
    """`Group`s of (scope, `Doubt`), the gravest first; each text of a scope once."""
    groups = []
    for name, kind in KINDS.items():
        lines = [(scope, doubt.text) for scope, doubt in doubts if doubt.kind == name]
        if lines:
            groups.append(Group(kind.title, kind.advice, list(dict.fromkeys(lines))))
    return groups


def _not_registered(table, study):
    # Of a pair that is as the others there is nothing to explain.
    pairs = [row for row in pairs_of(table).itertuples() if not row.reason.startswith(USUAL)]
    excluded = [f"{study.pair(row)} ({row.reason})" for row in pairs if row.reason]
    kind, word = ("not_explained", "explained") if study.here else ("not_registered", "registered")
    return [Doubt(kind, f"Not {word}: {', '.join(excluded)}.")] if excluded else []


def _remarks(table, study):
    """The remarks of the rows, each with all of its pairs; of A/A values `_unsettled` tells."""
    found = []
    for remark, rows in _by_remark(table):
        if kind_of(remark) != "few_decide":
            text = f"{_where(rows, study)} ({_counted(len(rows), 'instance')}): {remark}."
            found.append(Doubt(kind_of(remark), text))
    return found


def _by_remark(table):
    """Each remark of a table's warnings, and the rows that have it."""
    table = table.reset_index(drop=True)
    remarks = table.warning.str.split("; ").explode()
    for remark, rows in table.loc[remarks.index].groupby(remarks.to_numpy(), sort=False):
        if remark:
            yield remark, rows


def _where(rows, study):
    names = [study.pair(row) for row in pairs_of(rows).itertuples()]
    return ", ".join(names) if len(names) <= FEW_PAIRS else f"{len(names)} pairs"


def _counted(number, noun):
    return f"{number:,} {noun}{'s' * (number > 1)}"


def _floor_sensitivity(table, study):
    """How far the covariance floor decides the Shapley values, where a warning is about it."""
    of_floor = table.warning.map(lambda text: any(mark in text for mark in KINDS["floor"].marks))
    doubtful = study.valued(table[of_floor.astype(bool)])
    parts = []
    for cause in study.shown(doubtful):
        phi = doubtful[f"phi_{cause.name}"]
        tenfold, tenth = (
            (doubtful[f"phi_{cause.name}_floor_{floor}"] - phi).abs().max()
            for floor in ("tenfold", "tenth")
        )
        parts.append(f"{cause.title} {tenfold:.2g} and {tenth:.2g}")
    if not parts:
        return []
    text = "With ten times and with a tenth of the covariance floor φ changes by at most: "
    return [Doubt("floor", f"{text}{', '.join(parts)}.")]


def _unsettled(table, study):
    """Which pairs' A/A values are above the noise floor, and which of them far above."""
    valued = study.valued(pairs_of(table))
    kinds = [list(map(kind_of, text.split("; "))) for text in valued.warning]
    by_far = np.array(["few_decide" in of for of in kinds], dtype=bool)
    far, unsettled = valued[by_far], valued[(valued.f_again > valued.null_95) | by_far]
    if len(unsettled) == 0:
        return []
    of = f"{len(unsettled)} of {_counted(len(valued), 'pair')}: " * (len(valued) > 1)
    beyond = f", and in {_where(far, study)} by far" * (len(far) > 0)
    text = (
        f"{of}two clean samples differ by more than the noise floor{beyond}, f = "
        f"{words.number(unsettled.f_again.max())} {study.unit}{' at most' * (len(valued) > 1)}: an "
        "f of that size need not come from any cause."
    )
    return [Doubt("few_decide", text[0].upper() + text[1:])]


def _basins(table, study):
    """How many runs end in a wrong basin, and what the Shapley values are with and without them."""
    kept = study.valued(table)
    most, runs = kept.n_wrong_basin.max(), kept.n_runs.max()
    if not (study.returns.samples and most > 0):
        return []
    done = {"keep": "kept", "leave_out": "left out"}[study.wrong_basins]
    number = f"{most:.0f} of {runs}"
    if len(kept) > 1:
        number = f"{kept.n_wrong_basin.median():.0f} of {runs} in the median, at most {most}"
    setting = "a setting" if len(kept) == 1 else "a setting of an instance"
    sentences = [f"{study.repeats.capitalize()} in a wrong basin in {setting}: {number}; {done}."]
    both = kept[kept.f_right_basin.notna()]
    if len(both):
        where = "" if len(both) == len(kept) else f" of the {len(both)} instances that allow it"
        parts = ", ".join(_with_and_without(both, study))
        median = "Median " * (len(both) > 1)
        sentences.append(f"{median}φ{where} with and without such {study.repeats}: {parts}.")
    if len(both) < len(kept):
        of = f" for {len(kept) - len(both)} of {len(kept)} instances" * (len(kept) > 1)
        sentences.append(f"Too few {study.repeats} are left without them{of}.")
    return [Doubt("basins", " ".join(sentences))]


def _with_and_without(table, study):
    for cause in study.shown(table):
        rows = study.present(table, cause)
        kept, left_out = (
            words.number(rows[f"phi_{cause.name}_{which}"].median())
            for which in ("all", "right_basin")
        )
        yield f"{cause.title} {kept} and {left_out}"


def _left_out(table, study):
    found = []
    failed = table[table.n_failed > 0]
    if len(failed):
        has = "has" if len(failed) == 1 else "have"
        text = (
            f"{_counted(len(failed), 'instance')} {has} {study.repeats} that failed, at most "
            f"{failed.n_failed.max()} of {failed.n_runs.max()}; these are left out of all of the "
            "instance's settings."
        )
        found.append(Doubt("failed", text))
    without = len(table[table.reason == ""]) - len(study.valued(table))
    if without:
        has = "has" if without == 1 else "have"
        text = f"{_counted(without, 'instance')} {has} no value: too few {study.repeats} were left."
        found.append(Doubt("no_value", text))
    return found
