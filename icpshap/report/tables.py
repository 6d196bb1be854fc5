"""The paper's Table 1 of our results, beside the paper's: as Markdown and as LaTeX.

A ranking is the table of `explanation.ranking.ranking_table`, a study a `study.Study`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from tabulate import tabulate

from icpshap.report import words

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.report.study import Study


DEFAULT_RULE = "iqr"
RULES = {
    "none": "none",
    "iqr": "1.5 interquartile ranges",
    "positive_then_iqr": "negative rows, then 1.5 interquartile ranges",
}
LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{letter: f"\\{letter}" for letter in "_&%#${}"},
}
UNSURE = {"pipe": "°", "html": "°", "latex_raw": r"$^\circ$"}


def median_rows(ranking: pd.DataFrame) -> pd.DataFrame:
    """The rows of a ranking table by the default outlier rule; of few pairs those without one."""
    judged = ranking.groupby("sequence").outlier_rule.transform("nunique") > 1
    return ranking[(ranking.outlier_rule == DEFAULT_RULE) | ~judged]


def markdown(ranking: pd.DataFrame, study: Study) -> str:
    """The medians with their note, and the medians under each reading of the outlier rule."""
    if len(ranking) == 0:
        return "No pair has a value.\n"
    text = _table(ranking, study, "pipe")
    parts = (text, note(ranking, study), _rules_table(ranking, study, "pipe"))
    return "\n\n".join(filter(None, parts)) + "\n"


def html(ranking: pd.DataFrame, study: Study) -> str:
    """The medians, and below them the medians under each reading of the outlier rule."""
    if len(ranking) == 0:
        return "<p>No pair has a value.</p>"
    return _table(ranking, study, "html") + _rules_table(ranking, study, "html")


def latex(ranking: pd.DataFrame, study: Study) -> str:
    """The medians as a tabular environment."""
    if len(ranking) == 0:
        return "% No pair has a value.\n"
    text = _table(ranking, study, "latex_raw").replace(" > ", " $>$ ")
    note_ = note(ranking, study).replace("°", UNSURE["latex_raw"])
    return f"% {note_}\n{text}\n"


def _table(ranking, study, form):
    rows = median_rows(ranking)
    compared = [c for c in study.players if rows[f"paper_{c.name}"].notna().any()]
    header = ["Sequence", "Pairs"]
    for cause in study.players:
        header.append(f"{cause.title} [{study.unit}]")
        header += ["paper"] * (cause in compared)
    header += [f"P({' > '.join(words.titles(order.split(' > ')))})" for order in _orders(rows)]
    body = []
    for row in rows.itertuples():
        title = escaped(study.title(row.sequence), form)
        line = [title, f"{row.n_rows - row.n_removed} of {row.n_rows}"]
        for cause in study.players:
            line.append(estimate(row, cause.name, form))
            line += [_paper(row, cause.name)] * (cause in compared)
        body.append(line + [_probability(row) for _ in _orders(rows)])
    return tabulate(body, header, tablefmt=form, disable_numparse=True)


def escaped(text: str, form: str) -> str:
    """A user's text as the form of a table shows it; HTML is escaped where the table is made."""
    if form == "latex_raw":
        return "".join(LATEX.get(letter, letter) for letter in text)
    return text.replace("|", "\\|") if form == "pipe" else text


def _orders(rows):
    """The order of causes whose probability the rows hold: one, or none."""
    return list(rows.order.dropna().unique())


def _probability(row):
    known = np.isfinite(row.probability)
    return f"{row.probability:.2f} (p = {row.p_holm:.2g})" if known else ""


def estimate(row: Any, name: str, form: str) -> str:
    """A median with its interval, marked where 0 lies in it."""
    median, low, high = (getattr(row, f"median_{name}{end}") for end in ("", "_low", "_high"))
    if np.isnan(median):
        return "no value"
    unsure = UNSURE[form] if low <= 0 <= high else ""
    return f"{words.with_interval(median, low, high)}{unsure}"


def _rules_table(ranking, study, form):
    """The medians under each reading of the paper's outlier rule, "" where none is applied."""
    ranking = ranking[ranking.groupby("sequence").outlier_rule.transform("nunique") > 1]
    if len(ranking) == 0:
        return ""
    header = [
        "Sequence",
        "Outlier rule",
        "Pairs left",
        *(f"{c.title} [{study.unit}]" for c in study.players),
    ]
    body = [
        [
            escaped(study.title(row.sequence), form),
            RULES[row.outlier_rule],
            row.n_rows - row.n_removed,
            *(estimate(row, cause.name, form) for cause in study.players),
        ]
        for row in ranking.itertuples()
    ]
    return tabulate(body, header, tablefmt=form, disable_numparse=True)


def note(ranking: pd.DataFrame, study: Study) -> str:
    """What the table shows."""
    rows = median_rows(ranking)
    sentences = [
        f"Median Shapley values of the pairs of each sequence, estimator {study.estimator}, with "
        f"95 % intervals from a bootstrap over {_resampled(study)}. ° cannot be distinguished from "
        "zero."
    ]
    if (rows.outlier_rule == DEFAULT_RULE).any():
        sentences.append(
            "A pair goes if any of its values lies more than 1.5 interquartile ranges outside the "
            "quartiles."
        )
    if _orders(rows):
        sentences.append(
            "P is the share of the bootstrap in which the medians have the order given; p is "
            "one-sided, with Holm's correction for the number of sequences."
        )
    inside = np.concatenate(
        [rows.loc[rows[f"paper_{n}"].notna(), f"paper_{n}_inside"] for n in study.causes]
    )
    if len(inside):
        sentences.append(
            f"{inside.sum():.0f} of the paper's {len(inside)} values lie in our intervals."
        )
    for warning, part in rows[rows.warning != ""].groupby("warning", sort=False):
        sentences.append(f"{', '.join(map(study.title, part.sequence))}: {warning}.")
    return " ".join(sentences)


def _resampled(study):
    """What the bootstrap draws again: pairs, and what an estimate leaves out for its interval."""
    if study.returns.exchangeable:
        return "pairs and runs"
    return " and ".join(filter(None, ["pairs", study.returns.units(study.noise_draws)]))


def _paper(row, name):
    value = getattr(row, f"paper_{name}")
    return "" if np.isnan(value) else f"{value:.2f}"
