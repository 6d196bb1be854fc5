"""Ours against the paper: medians of every sequence, the waterfall plot and the summary plot.

What the paper compares is named here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from tabulate import tabulate

from icpshap.causes import CAUSES, named
from icpshap.report import words
from icpshap.report.figures.style import INK, MUTED, PAGE, say_nothing, styled, tame, value_label
from icpshap.report.tables import escaped, median_rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from icpshap.report.study import Study


# The pair and the perturbation of the paper's figures and of its table, and the order it finds.
FIGURE_PAIR = ("apartment", 6, 7)
TABLE_PERTURBATION = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
PAPER_ORDER = ("sensor_noise", "partial_overlap", "initial_pose")
PALETTE = ("#E69F00", "#56B4E9", "#CC79A7", "#009E73", "#0072B2")
COLUMNS = [
    "experiment",
    "estimator",
    "shown_in",
    "sequence",
    "quantity",
    "value",
    "low",
    "high",
    "paper_low",
    "paper_high",
]


def is_comparable(shap: pd.DataFrame, study: Study) -> bool:
    """Whether medians of a shap table are of the quantity that Table 1 shows."""
    if not _plays_the_papers_game(study):
        return False
    instances = shap[list(study.causes)].drop_duplicates()
    same = study.instance(instances, TABLE_PERTURBATION)
    return len(instances) == len(same) == 1


def _plays_the_papers_game(study):
    """Whether f and the players are the paper's, whatever estimates the uncertainty."""
    players = set(study.causes) == set(TABLE_PERTURBATION)
    return study.divergence == "kl" and players and not study.variants


def compare_medians(ranking: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Rows for Table 1: our medians and intervals beside the paper's values."""
    rows = []
    for row in median_rows(ranking).to_dict(orient="records"):
        for name in study.causes:
            paper = row[f"paper_{name}"]
            if np.isfinite(paper):
                ours = [row[f"median_{name}{end}"] for end in ("", "_low", "_high")]
                rows.append(("Table 1", row["sequence"], name, *ours, paper, paper))
    return _frame(rows, study)


def compare_figures(shap: pd.DataFrame, figures: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Rows for the waterfall and the summary plot of a grid over the paper's pair.

    figures: the reference table of values read off the paper's figures. The summary plot's rows
    hold the range over the grid where there is sensor noise, and the median as value. No rows for
    an experiment with other causes or another f.
    """
    if not _plays_the_papers_game(study):
        return _frame([], study)
    sequence, reference, source = FIGURE_PAIR
    of_pair = (shap.sequence == sequence) & (shap.reference == reference) & (shap.source == source)
    table = study.valued(shap[of_pair])
    rows = []
    for entry in figures.to_dict(orient="records"):
        name = entry["quantity"]
        paper = entry["low"], entry["high"]
        ours = _counterpart(table, entry, study)
        if ours:
            where = f"{entry['figure']} plot"
            rows.append((where, sequence, name.removeprefix("phi_"), *ours, *paper))
    return _frame(rows, study)


def _counterpart(table, entry, study):
    """Our value, low and high of an entry of the reference table; None where there is nothing."""
    name = entry["quantity"]
    if entry["figure"] == "waterfall":
        shown = study.instance(table, entry)
        ends = [shown[f"{name}{end}"] for end in ("", "_low", "_high")]
        return [end.iloc[0] for end in ends] if len(shown) else None
    shown = table[table.sensor_noise > 0][name]
    return [shown.median(), shown.min(), shown.max()] if len(shown) else None


def _frame(rows, study):
    frame = pd.DataFrame(rows, columns=COLUMNS[2:])
    frame.insert(0, "estimator", study.estimator)
    frame.insert(0, "experiment", study.name)
    return frame


# --- the table ------------------------------------------------------------------------------------

HEADER = ["Paper", "Sequence", "Quantity", "Estimator", "Paper's value", "Ours"]
NOTHING = "No selected experiment has a counterpart in the paper."


def markdown(table: pd.DataFrame, titles: Mapping[str, str]) -> str:
    """The comparison as Markdown; titles: names of sequences by their keys."""
    return _layout(table, titles, "pipe") + "\n"


def html(table: pd.DataFrame, titles: Mapping[str, str]) -> str:
    """The comparison as an HTML table."""
    return _layout(table, titles, "html")


def _layout(table, titles, form):
    return tabulate(_body(table, titles, form), HEADER, tablefmt=form, disable_numparse=True)


def _body(table, titles, form):
    lines = []
    for row in table.sort_values(["shown_in", "sequence", "quantity"], kind="stable").itertuples():
        paper = f"{row.paper_low:.2f}"
        if row.paper_high != row.paper_low:
            paper += f" to {row.paper_high:.2f}"
        lines.append(
            [
                row.shown_in,
                escaped(titles.get(row.sequence, row.sequence), form),
                CAUSES[row.quantity].title if row.quantity in CAUSES else row.quantity,
                row.estimator,
                paper,
                words.with_interval(row.value, row.low, row.high),
            ]
        )
    return lines


def caption(table: pd.DataFrame) -> str:
    """What the table and the figure of the comparison show."""
    if len(table) == 0:
        return NOTHING
    single = table[(table.shown_in != "summary plot") & table.low.notna()]
    held = ((single.low <= single.paper_low) & (single.paper_high <= single.high)).sum()
    return (
        "Ours (dots with 95 % intervals, a colour for each estimator) against the paper "
        "(diamonds): medians of Table 1, and the values of the waterfall and the summary plot, as "
        "read off the released figures. For the summary plot, bars are ranges over the grid where "
        f"there is sensor noise, and dots medians. {held} of {len(single)} single values of the "
        "paper lie in our intervals."
    )


# --- the figure -----------------------------------------------------------------------------------


def draw(table: pd.DataFrame, titles: Mapping[str, str]) -> Figure:
    """A panel for each cause of the paper: the paper's values and those of every estimator."""
    with styled():
        lines = list(dict.fromkeys(zip(table.shown_in, table.sequence, strict=True)))
        figure = plt.figure(figsize=(PAGE, 1.1 + 0.26 * len(lines)))
        if len(table) == 0:
            return say_nothing(figure, NOTHING)
        causes = named(TABLE_PERTURBATION)
        panels = figure.subplots(1, len(causes), sharey=True)
        for axes, cause in zip(panels, causes, strict=True):
            _panel(axes, table[table.quantity == cause.name], lines, table.estimator.unique())
            axes.set_xlabel(value_label(cause, "nats"))
        panels[0].set_yticks(
            range(len(lines)), [f"{titles.get(key, key)}, {where}" for where, key in lines]
        )
        panels[0].set_ylim(len(lines) - 0.5, -0.5)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    return figure


def _panel(axes, rows, lines, estimators):
    """Values of one cause on their lines: each estimator's, and below them the paper's."""
    slots = np.linspace(-0.3, 0.3, len(estimators) + 1)
    for estimator, slot, colour in zip(estimators, slots, cycle(PALETTE)):
        own = rows[rows.estimator == estimator]
        y = _places(own, lines) + slot
        axes.hlines(y, own.low, own.high, color=colour, linewidth=1)
        label = f"ours, estimator {estimator}"
        axes.plot(own.value, y, "o", color=colour, markersize=3, label=label)
    y = _places(rows, lines) + slots[-1]
    axes.hlines(y, rows.paper_low, rows.paper_high, color=INK, linewidth=1)
    single = (rows.paper_low == rows.paper_high).to_numpy()
    axes.plot(rows.paper_low[single], y[single], "D", color=INK, markersize=3, label="the paper")
    axes.axvline(0, color=MUTED, linewidth=0.5, zorder=-1)
    tame(axes, "x", rows[["low", "high"]].to_numpy())


def _places(rows, lines):
    return np.array(
        [lines.index(pair) for pair in zip(rows.shown_in, rows.sequence, strict=True)], dtype=float
    )
