"""The paper's Table 1 of our results, beside the paper's: as Markdown and as LaTeX."""

import numpy as np
from tabulate import tabulate

from icpshap.causes import SOURCES
from icpshap.report import captions

DEFAULT_RULE = "iqr"
RULES = {
    "none": "none",
    "iqr": "1.5 interquartile ranges",
    "positive_then_iqr": "negative rows, then 1.5 interquartile ranges",
}
UNSURE = {"pipe": "°", "html": "°", "latex_raw": r"$^\circ$"}


def median_rows(ranking):
    """The rows of a ranking table under the default outlier rule."""
    return ranking[ranking.outlier_rule == DEFAULT_RULE]


def markdown(ranking, study):
    """The medians with their note, and the medians under each reading of the outlier rule."""
    if len(ranking) == 0:
        return "No pair has a value.\n"
    text = _table(ranking, study, "pipe")
    return f"{text}\n\n{note(ranking, study)}\n\n{_rules_table(ranking, study, 'pipe')}\n"


def html(ranking, study):
    """The medians, and below them the medians under each reading of the outlier rule."""
    if len(ranking) == 0:
        return "<p>No pair has a value.</p>"
    return _table(ranking, study, "html") + _rules_table(ranking, study, "html")


def latex(ranking, study):
    """The medians as a tabular environment."""
    if len(ranking) == 0:
        return "% No pair has a value.\n"
    text = _table(ranking, study, "latex_raw").replace(" > ", " $>$ ")
    note_ = note(ranking, study).replace("°", UNSURE["latex_raw"])
    return f"% {note_}\n{text}\n"


def _table(ranking, study, form):
    rows = median_rows(ranking)
    compared = [s for s in SOURCES if rows[f"paper_{s.name}"].notna().any()]
    header = ["Sequence", "Pairs"]
    for source in SOURCES:
        header.append(f"{source.title} [{study.unit}]")
        header += ["paper"] * (source in compared)
    header.append(f"P({' > '.join(_titles(rows.order.iloc[0]))})")
    body = []
    for row in rows.itertuples():
        line = [study.title(row.sequence), f"{row.n_rows - row.n_removed} of {row.n_rows}"]
        for source in SOURCES:
            line.append(estimate(row, source.name, form))
            line += [_paper(row, source.name)] * (source in compared)
        known = np.isfinite(row.probability)
        body.append([*line, f"{row.probability:.2f} (p = {row.p_holm:.2g})" if known else ""])
    return tabulate(body, header, tablefmt=form, disable_numparse=True)


def estimate(row, name, form):
    """A median with its interval, marked where 0 lies in it."""
    median, low, high = (getattr(row, f"median_{name}{end}") for end in ("", "_low", "_high"))
    if np.isnan(median):
        return "no value"
    unsure = UNSURE[form] if low <= 0 <= high else ""
    return f"{captions.number(median)} {captions.interval(low, high)}{unsure}"


def _rules_table(ranking, study, form):
    """The medians under each reading of the paper's outlier rule."""
    header = [
        "Sequence",
        "Outlier rule",
        "Pairs left",
        *(f"{s.title} [{study.unit}]" for s in SOURCES),
    ]
    body = [
        [
            study.title(row.sequence),
            RULES[row.outlier_rule],
            row.n_rows - row.n_removed,
            *(estimate(row, source.name, form) for source in SOURCES),
        ]
        for row in ranking.itertuples()
    ]
    return tabulate(body, header, tablefmt=form, disable_numparse=True)


def note(ranking, study):
    """What the table shows."""
    rows = median_rows(ranking)
    sentences = [
        f"Median Shapley values of the pairs of each sequence, estimator {study.estimator}, with "
        "95 % intervals from a bootstrap over pairs and runs. A pair goes if any of its three "
        "values lies more than 1.5 interquartile ranges outside the quartiles. "
        "° cannot be distinguished from zero.",
        "P is the share of the bootstrap in which the medians have the order given; p is "
        "one-sided, with Holm's correction for the number of sequences.",
    ]
    paper = np.concatenate(
        [rows.loc[rows[f"paper_{s.name}"].notna(), f"paper_{s.name}_inside"] for s in SOURCES]
    )
    if len(paper):
        sentences.append(
            f"{paper.sum():.0f} of the paper's {len(paper)} values lie in our intervals."
        )
    for warning, part in rows[rows.warning != ""].groupby("warning", sort=False):
        sentences.append(f"{', '.join(map(study.title, part.sequence))}: {warning}.")
    return " ".join(sentences)


def _titles(order):
    by_name = {source.name: source.title for source in SOURCES}
    return [by_name[name] for name in order.split(" > ")]


def _paper(row, name):
    value = getattr(row, f"paper_{name}")
    return "" if np.isnan(value) else f"{value:.2f}"
