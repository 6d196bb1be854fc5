"""What follows from an explanation, in words: what shrinks, what a removal brings, wrong basins.

Tables are shap tables, and studies `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from tabulate import tabulate

from icpshap.report import words
from icpshap.report.study import contains_zero, judged

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.causes.cause import Cause
    from icpshap.report.study import Study


MOST = 0.5  # of the rows in which a cause is on, from which the whole is named after them


def narrowing(table: pd.DataFrame, study: Study) -> list[Cause]:
    """The causes that narrow the spread in any row in which they are on."""
    return [
        cause
        for cause in study.shown(table)
        if study.present(table, cause)[f"narrows_{cause.name}"].any()
    ]


def no_basin(table: pd.DataFrame, study: Study) -> str:
    """How many instances have a setting whose runs do not lie together; "" for none."""
    number = table.no_basin.sum()
    if not number:
        return ""
    where = f"in {number:,} of {len(table):,} instances " * (len(table) > 1)
    return (
        f"{where}fewer than half of the {study.repeats} of a "
        "setting lie together, so that it has no basin: no share of wrong basins, and a covariance "
        "that says little"
    )


def success(table: pd.DataFrame, study: Study) -> str:
    """How often a registration that is not ours ends at the true pose; "" for our own."""
    if not study.estimator_kind.foreign or table.success_rate.isna().all():
        return ""
    clean, on = (
        f"{100 * table[name].median():.0f} %" for name in ("clean_success_rate", "success_rate")
    )
    return (
        f"{study.estimator} ends within 0.1 m and 2 degrees of the true pose in {clean} of its "
        f"runs clean and {on} with all causes on{', in the median' * (len(table) > 1)}"
    )


def shrinking(table: pd.DataFrame, study: Study, with_error: bool = True) -> str:
    """Where the spread gets smaller, by how much, and through which cause; "" where it does not.

    with_error: whether the error is told beside it.
    """
    kept = study.valued(table)
    shrunk, narrow = kept[kept.shrinks], narrowing(table, study)
    parts = []
    if len(shrunk):
        where = f" in {len(shrunk):,} of {len(kept):,} instances" * (len(kept) > 1)
        parts.append(
            f"the spread shrinks{where} (half the log determinant of its covariance changes by "
            f"{words.of_rows(shrunk, 'entropy_difference', 'nats')}"
            f"{_errors(shrunk) * with_error})"
        )
    for cause in narrow:
        marks = study.present(table, cause)[f"narrows_{cause.name}"]
        some = not marks.all()
        where = f" in {marks.sum():,} of {len(marks):,} instances" if some else ""
        parts.append(
            f"{cause.title} narrows the spread{where} and is no source of uncertainty"
            f"{' there' * some}, though f counts any change"
        )
    return "; ".join(parts)


def _errors(rows):
    before, after = rows.clean_translation_rmse.median(), rows.translation_rmse.median()
    if np.isnan(before) or np.isnan(after):
        return ""
    return f", translation RMSE from {words.centimetres(before)} to {words.centimetres(after)} cm"


def removal(table: pd.DataFrame, study: Study, largest: Cause) -> str:
    """Which removal brings most, where that is not of the cause `largest`; "" else."""
    effects = {}
    for cause in study.shown(table):
        rows = study.present(table, cause)
        if len(rows):
            effects[cause] = rows[f"removal_{cause.name}"].median()
    best = max(effects, key=effects.__getitem__)
    if best == largest:
        return ""
    one, other = (_removed(study.present(table, cause), cause, study) for cause in (best, largest))
    return f"but removing {best.title} lowers f most, by {one}, removing {largest.title} by {other}"


def _removed(rows, cause, study):
    """The removal effect of a cause, and whether it can be told from zero."""
    name = f"removal_{cause.name}"
    text = words.of_rows(rows, name, study.unit)
    known = judged(rows, name)
    unclear = len(known) and contains_zero(known, name).mean() > MOST
    return f"{text} (cannot be told from zero)" if unclear else text


def shares(table: pd.DataFrame, study: Study) -> list[str]:
    """What share of the runs ends in a wrong basin, clean and perturbed; none without samples."""
    # Known even where too few runs are left for f.
    kept = table[table.wrong_basin_share.notna()]
    if len(kept) == 0:
        return []
    clean, share = (words.of_rows(kept, f"{name}wrong_basin_share", "%") for name in ("clean_", ""))
    return [
        f"Share of {study.repeats} that failed or ended in a wrong basin: {clean} clean, {share} "
        "with all causes on."
    ]


def table_of_causes(table: pd.DataFrame, study: Study, form: str = "html") -> str:
    """Of each cause phi, removal effect and part of the wrong-basin share, side by side.

    Of one instance with intervals, of several the medians over those in which the cause is on.
    """
    header = [
        "Cause",
        f"φ [{study.unit}]",
        f"removal effect [{study.unit}]",
        "wrong basins",
    ]
    body = []
    for cause in study.shown(table):
        rows = table[table[cause.name] != cause.off]
        if not rows[[f"phi_{cause.name}", f"wrong_basin_{cause.name}"]].notna().any(axis=None):
            continue
        narrow = " (narrows the spread)" * (cause in narrowing(table, study))
        body.append(
            [
                f"{cause.title}{narrow}",
                words.cell(rows, f"phi_{cause.name}"),
                words.cell(rows, f"removal_{cause.name}"),
                words.cell(rows, f"wrong_basin_{cause.name}", "%"),
            ]
        )
    return tabulate(body, header, tablefmt=form, disable_numparse=True) if body else ""


def note_of_causes(table: pd.DataFrame, study: Study) -> str:
    """What the table of the causes shows."""
    medians = " Medians over the instances in which a cause is on." * (len(table) > 1)
    return (
        "φ says how f is shared out, the removal effect what f falls by without the cause, the "
        f"last column how many more {study.repeats} failed or ended in a wrong basin by it."
        f"{medians}"
    )
