"""How the settings fit the scans, in words and as a table: the first box of the report.

Tables are shap tables and fit tables, and studies `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tabulate import tabulate

from icpshap.fit import checks
from icpshap.report.study import pairs_of

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.report.study import Study


GRADES = {"red": "breaks the answer", "remark": "remark", "fits": "fits"}


def misfits(table: pd.DataFrame, study: Study) -> str:
    """What breaks the answers of a shap table, each with its pairs: a sentence; "" for nothing."""
    wrong = table[table.misfit != ""]
    if wrong.empty:
        return ""
    found = []
    for text, rows in wrong.groupby("misfit", sort=False):
        pairs = dict.fromkeys(study.run_pair(row) for row in pairs_of(rows).itertuples())
        several = len(pairs_of(table)) > 1
        found.append(f"{', '.join(pairs)}: {text}" if several else text)
    return f"The settings do not fit the scans, which breaks this answer. {' '.join(found)}"


def first(text: str, broken: str, mark: str = "") -> str:
    """A text behind what breaks it, the sentence of `misfits`; mark: stands before that."""
    return f"{mark}{broken}\n\n{text}" if broken else text


def html(fit: pd.DataFrame, study: Study) -> str:
    """A fit table over all its pairs, a row a check, as an HTML table."""
    rows = []
    several = len(pairs_of(fit)) > 1
    for row in checks.by_check(fit).itertuples():
        of = f"{study.pair(row)}, and {row.number - 1} more of {row.pairs} pairs"
        of = study.pair(row) if row.number == 1 else of
        found = f"{row.sentence[0].upper()}{row.sentence[1:]}."
        found += f" ({of})" * (several and row.grade != "fits")
        rows.append([GRADES[row.grade], row.check, found, row.expected, row.remedy])
    header = ["", "check", "found", "right", "what may mend it (not tried)"]
    return tabulate(rows, header, tablefmt="html", disable_numparse=True)
