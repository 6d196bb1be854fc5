"""Directions and the growth of the error in words, in centimetres and degrees.

Tables are directions tables, and studies `study.Study`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from tabulate import tabulate

from icpshap.explanation.directions import VECTOR
from icpshap.report import words
from icpshap.report.study import PAIR, pairs_of

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.causes.cause import Cause
    from icpshap.report.study import Study


ORDER = (
    "translation_x",
    "translation_y",
    "translation_z",
    "translation",
    "rotation_x",
    "rotation_y",
    "rotation_z",
    "rotation",
    "weakest",
    "error_translation",
    "error_rotation",
)
NAMES = {
    "error_translation": "squared error, translation",
    "error_rotation": "squared error, rotation",
}


class Part(NamedTuple):
    """What a cause adds [cm^2 or deg^2], its share of the growth, what remains without it.

    Of the instances in which it is on. interval, share_ends, remaining_ends (of the standard
    deviation that remains): text, "" but of one instance. unsure: whether most intervals contain 0.
    """

    cause: type
    value: float
    interval: str
    share: float
    share_ends: str
    remaining: float
    remaining_ends: str
    unsure: bool


class Row(NamedTuple):
    """A direction: its words, the unit whose square its numbers have, and medians of instances.

    factor: from m or rad to the unit. Ends are intervals of the standard deviations and of the
    95 % quantiles, as text; vector (6,): of the direction, rotation first in units of 1/L, NaN
    where it is none or differs between instances.
    """

    name: str
    words: str
    unit: str
    factor: float
    clean: float
    clean_ends: str
    value: float
    value_ends: str
    vector: np.ndarray
    parts: list
    in_per_cent: bool
    clean_quantile: float
    clean_quantile_ends: str
    quantile: float
    quantile_ends: str


def chosen(table: pd.DataFrame, study: Study) -> pd.DataFrame:
    """The rows that are shown: of the waterfall's instance where there is one, else all."""
    return study.instance(table, study.waterfall) if study.waterfall else table


def summary(table: pd.DataFrame, study: Study) -> list[Row]:
    """A `Row` for each direction with values, medians over the instances that are shown."""
    return medians(chosen(table, study), study.shown(table))


def medians(table: pd.DataFrame, shown: Sequence[Cause]) -> list[Row]:
    """A `Row` for each direction with values, medians over the instances of the table."""
    rows = []
    for name in ORDER:
        found = table[(table.direction == name) & table.value.notna()]
        if len(found):
            rows.append(_row(name, found, shown))
    return rows


def _row(name, found, shown):
    turns = "rotation" in name
    unit, factor = ("deg", np.rad2deg(1.0)) if turns else ("cm", 100.0)

    def of_deviation(end):
        return deviation(factor**2 * end)

    def of_quantile(end):
        return words.significant(factor * end)

    parts = []
    for cause in shown:
        on = found[found[cause.name] != cause.off]
        on = on if len(on) else found  # nowhere on: its part is 0
        phi, share, remaining = (f"{of}_{cause.name}" for of in ("phi", "share", "remaining"))
        unsure = (on[f"{phi}_low"] <= 0) & (on[f"{phi}_high"] >= 0)
        parts.append(
            Part(
                cause,
                factor**2 * on[phi].median(),
                _ends(on, phi, lambda end: words.significant(factor**2 * end)),
                on[share].median(),
                _ends(on, share, _per_cent),
                factor**2 * on[remaining].median(),
                _ends(on, remaining, of_deviation),
                bool(unsure.mean() > 0.5),
            )
        )
    told = found.words.unique()
    text = NAMES.get(name) or (told[0] if len(told) == 1 else "")
    if name == "weakest":
        text = f"weakest ({text})" if text else "weakest"
    vectors = found[VECTOR].to_numpy()
    return Row(
        name,
        text,
        unit,
        factor,
        factor**2 * found.clean.median(),
        _ends(found, "clean", of_deviation),
        factor**2 * found.value.median(),
        _ends(found, "value", of_deviation),
        vectors[0] if (vectors == vectors[0]).all() else np.full(len(VECTOR), np.nan),
        parts,
        bool(found.in_per_cent.all()),
        factor * found.clean_quantile_95.median(),
        _ends(found, "clean_quantile_95", of_quantile),
        factor * found.quantile_95.median(),
        _ends(found, "quantile_95", of_quantile),
    )


def _ends(rows, name, told):
    """The interval of a number of one instance, with its ends as told(end) says; else ""."""
    low, high = rows[f"{name}_low"], rows[f"{name}_high"]
    if len(rows) != 1 or low.isna().any() or high.isna().any():
        return ""
    return f" [{', '.join(told(end.iloc[0]) for end in (low, high))}]"


def _per_cent(share):
    return f"{100 * share:z.0f}"


def deviation(variance: float) -> str:
    """Standard deviation of a variance as text; an estimate of a variance may be below 0."""
    return words.significant(np.sqrt(max(variance, 0.0)))


def opening(table: pd.DataFrame, study: Study) -> str:
    """Which pairs and instances the numbers are of, the beginning of sentences; "" without any."""
    table = chosen(table, study)
    table, shown = table[table.value.notna()], study.shown(table)
    if not len(table):
        return ""
    pairs = pairs_of(table)
    number = len(table.drop_duplicates([*PAIR, "instance"]))
    if len(pairs) == 1:
        of = study.pair(next(pairs.itertuples()))
    else:
        of = f"{len(pairs)} pairs of {', '.join(map(study.title, pairs.sequence.unique()))}"
    if number == 1:
        return f"{of}, at {words.describe_values(table.iloc[0], shown)}:"
    return f"Medians over {number:,} instances of {of}, of a cause over those in which it is on:"


def sentences(table: pd.DataFrame, study: Study) -> list[str]:
    """What makes the weakest direction uncertain, and what the error grows by."""
    found = {row.name: row for row in summary(table, study)}
    told = []
    if "weakest" in found:
        told.append(_weakest(found["weakest"]))
    told += [_growth(found[name], kind) for name, kind in _errors(found)]
    return [text for text in told if text]


TABLE = ("error_translation", "error_rotation", "weakest")


def html(table: pd.DataFrame, study: Study) -> str:
    """What the error and the spread along the weakest direction are, and what makes them."""
    found = {row.name: row for row in summary(table, study)}
    rows = [found[name] for name in TABLE if name in found]
    if not rows:
        return ""
    header = ["", *(f"{_heading(row)} [{row.unit}]" for row in rows)]
    body = [
        ["clean", *(f"{deviation(row.clean)}{row.clean_ends}" for row in rows)],
        ["with all causes on", *(f"{deviation(row.value)}{row.value_ends}" for row in rows)],
    ]
    if any(np.isfinite(row.quantile) for row in rows):
        body += [
            [
                "95 % of the results within, clean",
                *(_quantile(row.clean_quantile, row.clean_quantile_ends) for row in rows),
            ],
            [
                "95 % of the results within, with all causes on",
                *(_quantile(row.quantile, row.quantile_ends) for row in rows),
            ],
        ]
    for number, part in enumerate(rows[0].parts):
        body += [
            [f"made by {part.cause.title}", *(_made_by(row, number) for row in rows)],
            [f"without {part.cause.title}", *(_without(row, number) for row in rows)],
        ]
    return tabulate(body, header, tablefmt="html", disable_numparse=True)


def _heading(row):
    name = {"error_translation": "error in translation", "error_rotation": "error in rotation"}
    return name.get(row.name, f"standard deviation along the {row.words} direction")


def _quantile(value, ends):
    """A quantile with its interval; "" where there is none."""
    return f"{words.significant(value)}{ends}" if np.isfinite(value) else ""


def _made_by(row, number):
    """What a cause adds to the square, in per cent of the growth where that may be told."""
    part = row.parts[number]
    if row.in_per_cent:
        return f"{_per_cent(part.share)} % of the growth{part.share_ends}"
    return f"{words.significant(part.value)}{part.interval} {row.unit}²"


def _without(row, number):
    return f"{deviation(row.parts[number].remaining)}{row.parts[number].remaining_ends}"


def note(table: pd.DataFrame, study: Study) -> str:
    """What the rows of the table of errors mean."""
    found = {row.name: row for row in summary(table, study)}
    sentences = []
    if set(found) & {"error_translation", "error_rotation"}:
        sentences.append(
            "Errors are root mean squares about the true pose over all results that did not fail, "
            "wrong basins included."
        )
    sentences.append(
        "Made by a cause is its Shapley value of the squared error or of the variance; without it "
        "is the error or the standard deviation that would remain."
    )
    if any("[" in cell for row in found.values() for cell in (row.clean_ends, row.value_ends)):
        sentences.append("In brackets 95 % intervals.")
    if any("∞" in f"{row.clean_quantile_ends}{row.quantile_ends}" for row in found.values()):
        sentences.append("∞: so few independent runs bound the error from below only.")
    if "weakest" in found:
        sentences.append(_vector(found["weakest"]))
    return " ".join(sentences)


def _vector(row):
    """The unit vector of the weakest direction, where all instances have the same."""
    if np.isnan(row.vector).any():
        return "Each instance has a weakest direction of its own."
    entries = [f"{entry:.2f}" for entry in row.vector]
    return (
        f"The unit vector of the weakest direction is ({', '.join(entries[:3])}) about and "
        f"({', '.join(entries[3:])}) along x, y and z."
    )


def _errors(found):
    names = (("error_translation", "translation"), ("error_rotation", "rotation"))
    return [(name, kind) for name, kind in names if name in found]


def _weakest(row):
    ranked = sorted(row.parts, key=lambda part: -part.value)
    parts = ", ".join(
        f"{part.cause.title} {words.significant(part.value)}{part.interval}" for part in ranked
    )
    remains = ", ".join(
        f"{deviation(part.remaining)}{part.remaining_ends} without {part.cause.title}"
        for part in ranked
    )
    along = row.words.removeprefix("weakest").strip()
    return (
        f"Along the weakest direction{f' {along}' if along else ''} the standard deviation goes "
        f"from {deviation(row.clean)}{row.clean_ends} to {deviation(row.value)}{row.value_ends} "
        f"{row.unit}; parts of the variance [{row.unit}²]: {parts}; it would be, in {row.unit}, "
        f"{remains}. {_vector(row)}"
    )


def _growth(row, kind):
    quantiles = ""
    if np.isfinite(row.quantile):
        before = f"{words.significant(row.clean_quantile)}{row.clean_quantile_ends}"
        after = f"{words.significant(row.quantile)}{row.quantile_ends}"
        unbounded = "; ∞: so few independent runs bound it from below only" * (
            "∞" in before + after
        )
        quantiles = f" (95 % quantile {before} to {after}{unbounded})"
    text = (
        f"The {kind} error (RMSE, wrong basins included) goes from {deviation(row.clean)}"
        f"{row.clean_ends} to {deviation(row.value)}{row.value_ends} {row.unit}{quantiles}; what "
        "the squared error grows by"
    )
    if row.in_per_cent:
        parts = (f"{p.cause.title} {_per_cent(p.share)} %{p.share_ends}" for p in row.parts)
        return f"{text}: {', '.join(parts)}."
    parts = (f"{p.cause.title} {words.significant(p.value)}{p.interval}" for p in row.parts)
    return f"{text} [{row.unit}²]: {', '.join(parts)}."
