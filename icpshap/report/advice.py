"""What to do: the best of what was tried; and what follows from the numbers, marked not tried.

Tables are shap, fit and what_if tables, and studies `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from icpshap.fit import checks
from icpshap.report import effects, here, what_if
from icpshap.report.study import contains_zero

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.report.study import Study


FIRST = 2  # remedies of the fit table that are told


def sentences(
    shap: pd.DataFrame, fit: pd.DataFrame, tried: pd.DataFrame | None, study: Study
) -> list[str]:
    """What to do, sentences; tried: the what_if table, or None."""
    found = [what_if.advice(tried, study)] if tried is not None else []
    removed = here.advice(shap, study) if study.here else _removal(shap, study)
    return [*found, *_remedies(fit), *removed]


def _remedies(fit):
    """The changes that mend the gravest misfits; those of their own before what says no more."""
    rows = checks.by_check(fit)
    rows = rows[rows.grade != "fits"]
    own = rows[rows.remedy != checks.AS_ABOVE]
    rows = (own if len(own) else rows).head(FIRST)
    return [f"What may mend {row.check} (not tried): {row.remedy}." for row in rows.itertuples()]


def _removal(shap, study):
    """The cause without which f falls most, if that can be told from zero in most instances."""
    kept = study.valued(shap)
    found = {}
    for cause in study.shown(kept):
        part = study.present(kept, cause)
        if part[f"narrows_{cause.name}"].mean() > effects.MOST:
            continue  # less of it makes no error smaller
        name = f"removal_{cause.name}"
        # An effect without an interval may be none.
        sure = part[f"{name}_low"].notna() & ~contains_zero(part, name)
        if len(part) and sure.mean() > 0.5 and part[name].median() > 0:
            found[cause] = part[name].median()
    if not found:
        return []
    cause = max(found, key=found.__getitem__)
    return [
        f"f falls most without {cause.title}. What may lower it (not tried): {cause.mitigation}."
    ]
