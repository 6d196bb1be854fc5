"""Directions and the growth of the error in words, in centimetres and degrees.

Tables are directions tables, and studies `study.Study`.
"""

from typing import NamedTuple

import numpy as np

from icpshap.report import words

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

    unsure: whether most intervals contain 0.
    """

    cause: type
    value: float
    share: float
    interval: str
    remaining: float
    unsure: bool


class Row(NamedTuple):
    """A direction: its words, the unit whose square its numbers have, and medians of instances."""

    words: str
    unit: str
    clean: float
    value: float
    parts: list
    in_per_cent: bool
    clean_quantile: float
    quantile: float


def chosen(table, study):
    """The rows that are shown: of the waterfall's instance where there is one, else all."""
    return study.instance(table, study.waterfall) if study.waterfall else table


def summary(table, study):
    """A `Row` for each direction with values, medians over the instances of the table."""
    table, shown = chosen(table, study), study.shown(table)
    rows = []
    for name in ORDER:
        found = table[(table.direction == name) & table.value.notna()]
        if len(found):
            rows.append(_row(name, found, shown))
    return rows


def _row(name, found, shown):
    turns = "rotation" in name
    unit, factor = ("°", np.rad2deg(1.0)) if turns else ("cm", 100.0)
    parts = []
    for cause in shown:
        phi, low, high = (found[f"phi_{cause.name}{end}"] for end in ("", "_low", "_high"))
        interval = ""
        if len(found) == 1 and low.notna().all():
            ends = (words.significant(factor**2 * end.iloc[0]) for end in (low, high))
            interval = f" [{', '.join(ends)}]"
        remaining = factor**2 * found[f"remaining_{cause.name}"].median()
        unsure = bool(((low <= 0) & (high >= 0)).mean() > 0.5)
        value, share = factor**2 * phi.median(), (phi / found.growth).median()
        parts.append(Part(cause, value, share, interval, remaining, unsure))
    told = found.words.unique()
    text = NAMES.get(name) or (told[0] if len(told) == 1 else "")
    if name == "weakest":
        text = f"weakest ({text})" if text else "weakest"
    return Row(
        text,
        unit,
        factor**2 * found.clean.median(),
        factor**2 * found.value.median(),
        parts,
        bool(found.in_per_cent.all()),
        factor * found.clean_quantile_95.median(),
        factor * found.quantile_95.median(),
    )


def deviation(variance):
    """Standard deviation of a variance as text; an estimate of a variance may be below 0."""
    return words.significant(np.sqrt(max(variance, 0.0)))


def sentences(table, study):
    """What makes the weakest direction uncertain, and what the error grows by."""
    found = {
        name: row for name, row in zip(_names(table, study), summary(table, study), strict=True)
    }
    told = []
    if "weakest" in found:
        told.append(_weakest(found["weakest"]))
    told += [_growth(found[name], kind) for name, kind in _errors(found)]
    return [text for text in told if text]


def _names(table, study):
    table = chosen(table, study)
    valued = set(table.direction[table.value.notna()])
    return [name for name in ORDER if name in valued]


def _errors(found):
    names = (("error_translation", "translation"), ("error_rotation", "rotation"))
    return [(name, kind) for name, kind in names if name in found]


def _weakest(row):
    ranked = sorted(row.parts, key=lambda part: -part.value)
    parts = ", ".join(
        f"{part.cause.title} {words.significant(part.value)}{part.interval}" for part in ranked
    )
    remains = ", ".join(
        f"{deviation(part.remaining)} without {part.cause.title}" for part in ranked
    )
    along = row.words.removeprefix("weakest").strip()
    return (
        f"Along the weakest direction{f' {along}' if along else ''} the standard deviation goes "
        f"from {deviation(row.clean)} to {deviation(row.value)} {row.unit}; parts of the variance "
        f"[{row.unit}²]: {parts}; it would be, in {row.unit}, {remains}."
    )


def _growth(row, kind):
    quantiles = ""
    if np.isfinite(row.quantile):
        ends = (words.significant(end) for end in (row.clean_quantile, row.quantile))
        quantiles = f" (95 % quantile {' to '.join(ends)})"
    text = (
        f"The {kind} error (RMSE, wrong basins included) goes from {deviation(row.clean)} to "
        f"{deviation(row.value)} {row.unit}{quantiles}; what the squared error grows by"
    )
    if row.in_per_cent:
        parts = (f"{p.cause.title} {100 * p.share:.0f} %" for p in row.parts)
        return f"{text}: {', '.join(parts)}."
    parts = (f"{p.cause.title} {words.significant(p.value)}{p.interval}" for p in row.parts)
    return f"{text} [{row.unit}²]: {', '.join(parts)}."
