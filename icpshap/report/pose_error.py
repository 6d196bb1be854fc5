"""What the pose error is, in one sentence: clean, with all causes on, and which cause makes it.

Of estimators that return no samples no error is known: the standard deviation of their covariance
is told in its place. Tables are directions tables, and studies `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.explanation.directions import AXES
from icpshap.report import directions, words
from icpshap.report.study import PAIR, pairs_of

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.report.study import Study


MOST = 0.5  # of a cause's part along three axes, from which one is named; of instances, for a sign
HARDLY = 0.1  # of the clean error: shares of a smaller change would make much of next to nothing
ERRORS = ("error_translation", "error_rotation")
VARIANCES = ("translation", "rotation")
WHERE = ("translation", "rotation")
ROOT_MEAN_SQUARE = "pose error (root mean square{medians})"
NO_SAMPLES = (
    "no pose samples and so no error, but the standard deviation of the covariance{medians}"
)


class Change(NamedTuple):
    """How a squared error or a variance changes: `directions.Row`, median growth in its unit's
    square, and its sign in most instances: 1, -1, or 0 where it cannot be told from zero, or where
    its root hardly changes."""

    where: str
    row: directions.Row
    growth: float
    sign: int
    hardly: bool


def sentence(table: pd.DataFrame, study: Study) -> str:
    """The error clean and with all causes on, and what it grows by; "" where nothing is known."""
    table, names = _told(table, study)
    if not names:
        return ""
    shown = study.shown(table)
    rows = {row.name: row for row in directions.medians(table, shown)}
    changes = [_change(where, rows[name], table) for where, name in zip(WHERE, names, strict=True)]
    clean, on = _before_and_after(changes)
    parts = [f"{_opening(changes, names, table)}: clean {clean}", f"with all causes {on}"]
    if np.isfinite([change.row.quantile for change in changes]).all():
        within = _listed(changes, lambda row: words.significant(row.quantile))
        parts[-1] += f" (95 % of the {study.repeats} within {within})"
    return "; ".join([*parts, *_causes(changes, rows, shown)])


def before_and_after(table: pd.DataFrame, study: Study) -> tuple[str, bool]:
    """The error clean and with all causes on, in short, and whether it is one; ("", False) if not
    known."""
    table, names = _told(table, study)
    if not names:
        return "", False
    rows = {row.name: row for row in directions.medians(table, study.shown(table))}
    clean, on = (
        ", ".join(f"{told(rows[name])} {rows[name].unit}" for name in names)
        for told in (_clean, _on)
    )
    return f"{clean} to {on}", names == ERRORS


def _told(table, study):
    """The rows with values in which all causes are on that ever are, and which of them to tell."""
    table = table[table.value.notna()]
    on = [table[cause.name] != cause.off for cause in study.shown(table)]
    together = np.all(on, axis=0) if on else np.zeros(len(table), dtype=bool)
    table = table[together] if together.any() else table
    known = set(table.direction)
    return table, next((names for names in (ERRORS, VARIANCES) if known.issuperset(names)), ())


def _change(where, row, table):
    rows = table[table.direction == row.name]
    unsure = (rows.growth_low <= 0) & (rows.growth_high >= 0)
    clean, on = np.sqrt(np.maximum([row.clean, row.value], 0))
    hardly = bool(abs(on - clean) <= HARDLY * clean)
    sign = 0 if hardly or unsure.mean() > MOST else int(np.sign(rows.growth.median()))
    return Change(where, row, row.factor**2 * rows.growth.median(), sign, hardly)


def _opening(changes, names, table):
    """What the numbers are, and first of all where they shrink."""
    known = ROOT_MEAN_SQUARE if names == ERRORS else NO_SAMPLES
    head = known.format(medians=_medians(table))
    shrinking = [change.where for change in changes if change.sign < 0]
    return f"{head} shrinks in {words.listed(shrinking)}" if shrinking else head


def _medians(table):
    """Of how many pairs or instances the numbers are the medians; "" of one."""
    number, pairs = len(table.drop_duplicates([*PAIR, "instance"])), len(pairs_of(table))
    if number == 1:
        return ""
    of = f"{pairs} pairs" if pairs == number else f"{number:,} instances"
    return f", medians over {of}"


def _before_and_after(changes):
    return (_listed(changes, told) for told in (_clean, _on))


def _clean(row):
    return directions.deviation(row.clean)


def _on(row):
    return directions.deviation(row.value)


def _listed(changes, told):
    """A number of the rows with their units, as in '0.7 cm, 0.06 deg'."""
    return ", ".join(f"{told(change.row)} {change.row.unit}" for change in changes)


def _causes(changes, rows, shown):
    """Which cause changes the error most, by how much, and what it would be without."""
    made: dict[int, list[Change]] = {}
    for change in changes:
        if change.sign:
            number = max(range(len(shown)), key=lambda k: change.sign * _part(change, k).value)
            made.setdefault(number, []).append(change)
    told = []
    for number, of in made.items():
        phrases = _made(of, number, rows)
        told.append(f"{shown[number].title} {', and '.join(phrases)}")
        if len(shown) > 1:  # without the only cause it would be the clean one
            without = _listed(
                changes, lambda row, k=number: directions.deviation(row.parts[k].remaining)
            )
            told.append(f"without it {without}")
    small = [change.where for change in changes if change.hardly]
    if small:
        told.append(f"hardly any change in {words.listed(small)} (less than a tenth)")
    unclear = [change.where for change in changes if not (change.sign or change.hardly)]
    if unclear:
        told.append(f"the growth in {words.listed(unclear)} cannot be told from zero")
    return told


def _part(change, number):
    return change.row.parts[number]


def _made(changes, number, rows):
    """What a cause does to the errors, after its name: a phrase each."""
    phrases: list[str] = []
    for change in changes:
        if change.sign < 0:
            again = "" if phrases and phrases[-1].startswith("lowers") else "lowers it most "
            phrases.append(f"{again}in {change.where}")
            continue
        again = "" if phrases and phrases[-1].startswith("makes") else "makes "
        along = _mostly(number, rows) if change.where == "translation" else ""
        phrases.append(f"{again}{_amount(change, number)}{along}")
    return phrases


def _amount(change, number):
    """How much of a growth is a cause's, in per cent where that may be told."""
    part, row = _part(change, number), change.row
    if row.in_per_cent:
        # Where another cause lowers the error, by chance or not, one makes more than there is.
        share = "more than all" if part.share > 1.005 else f"{100 * part.share:.0f} %"
        return f"{share} of the growth in {change.where}"
    squared = "squared error" if row.name in ERRORS else "variance"
    value, growth = words.significant(part.value), words.significant(change.growth)
    return f"{value} of the {growth} {row.unit}² that the {squared} grows by in {change.where}"


def _mostly(number, rows):
    """The axis along which most of a cause's part lies; "" where none has most of it."""
    along = {name: rows[name].parts[number].value for name in AXES if name in rows}
    along = {name: part for name, part in along.items() if name.startswith("translation")}
    largest = max(along, key=along.__getitem__, default="")
    total = sum(abs(part) for part in along.values())
    return f", mostly {AXES[largest]}" if total and along[largest] > MOST * total else ""
