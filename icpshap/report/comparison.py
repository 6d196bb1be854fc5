"""Ours against the paper: medians of every sequence, the waterfall plot and the summary plot."""

from itertools import cycle

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from tabulate import tabulate

from icpshap.causes import NAMES, SOURCES
from icpshap.report import captions
from icpshap.report.figures.style import INK, MUTED, PAGE, say_nothing, styled, tame, value_label

# The pair and the perturbation of the paper's figures and of its table.
FIGURE_PAIR = ("apartment", 6, 7)
TABLE_PERTURBATION = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
PALETTE = ("#E69F00", "#56B4E9", "#CC79A7", "#009E73", "#0072B2")
COLUMNS = [
    "experiment",
    "estimator",
    "shown_in",
    "sequence",
    "source",
    "value",
    "low",
    "high",
    "paper_low",
    "paper_high",
]


def is_comparable(shap, study):
    """Whether medians of a shap table are of the quantity that Table 1 shows."""
    instances = shap[list(NAMES)].drop_duplicates()
    same = captions.instance(instances, TABLE_PERTURBATION)
    return study.divergence == "kl" and len(instances) == len(same) == 1


def compare_medians(ranking, study):
    """Rows for Table 1: our medians and intervals beside the paper's values."""
    rows = []
    for row in ranking[ranking.outlier_rule == "iqr"].to_dict(orient="records"):
        for name in NAMES:
            paper = row[f"paper_{name}"]
            if np.isfinite(paper):
                ours = [row[f"median_{name}{end}"] for end in ("", "_low", "_high")]
                rows.append(("Table 1", row["sequence"], name, *ours, paper, paper))
    return _frame(rows, study)


def compare_figures(shap, figures, study):
    """Rows for the waterfall and the summary plot of a grid over the paper's pair.

    figures: the reference table of values read off the paper's figures. The summary plot's rows
    hold the range over the grid where there is sensor noise, and the median as value.
    """
    sequence, reference, source = FIGURE_PAIR
    of_pair = (shap.sequence == sequence) & (shap.reference == reference) & (shap.source == source)
    table = captions.valued(shap[of_pair])
    rows = []
    for entry in figures.to_dict(orient="records"):
        name = entry["quantity"]
        paper = entry["low"], entry["high"]
        if entry["figure"] == "waterfall":
            shown = captions.instance(table, entry)
            ours = [shown[f"{name}{end}"] for end in ("", "_low", "_high")]
            ours = [part.iloc[0] for part in ours] if len(shown) else None
        else:
            shown = table[table.sensor_noise > 0][name]
            ours = [shown.median(), shown.min(), shown.max()] if len(shown) else None
        if ours:
            where = f"{entry['figure']} plot"
            rows.append((where, sequence, name.removeprefix("phi_"), *ours, *paper))
    return _frame(rows, study)


def _frame(rows, study):
    frame = pd.DataFrame(rows, columns=COLUMNS[2:])
    frame.insert(0, "estimator", study.estimator)
    frame.insert(0, "experiment", study.name)
    return frame


HEADER = ["Paper", "Sequence", "Quantity", "Estimator", "Paper's value", "Ours"]
NOTHING = "No selected experiment has a counterpart in the paper."


def markdown(table, titles):
    """The comparison as Markdown."""
    return _layout(table, titles, "pipe") + "\n"


def html(table, titles):
    """The comparison as an HTML table."""
    return _layout(table, titles, "html")


def _layout(table, titles, form):
    return tabulate(_body(table, titles), HEADER, tablefmt=form, disable_numparse=True)


def _body(table, titles):
    source_titles = {source.name: source.title for source in SOURCES}
    lines = []
    for row in table.sort_values(["shown_in", "sequence", "source"], kind="stable").itertuples():
        paper = f"{row.paper_low:.2f}"
        if row.paper_high != row.paper_low:
            paper += f" to {row.paper_high:.2f}"
        lines.append(
            [
                row.shown_in,
                titles.get(row.sequence, row.sequence),
                source_titles.get(row.source, row.source),
                row.estimator,
                paper,
                f"{captions.number(row.value)} {captions.interval(row.low, row.high)}",
            ]
        )
    return lines


def caption(table):
    """What the table and the figure of the comparison show."""
    if len(table) == 0:
        return NOTHING
    inside = (table.low <= table.paper_low) & (table.paper_high <= table.high)
    medians = table[table.shown_in != "summary plot"]
    held = inside[medians.index].sum()
    return (
        "Ours (dots with 95 % intervals, a colour for each estimator) against the paper "
        "(diamonds): medians of Table 1, and the values of the waterfall and the summary plot, as "
        "read off the released figures. For the summary plot, bars are ranges over the grid where "
        f"there is sensor noise, and dots medians. {held} of {len(medians)} single values of the "
        "paper lie in our intervals."
    )


def draw(table, titles):
    """A panel for each uncertainty source: the paper's values and those of every estimator."""
    with styled():
        figure = plt.figure(figsize=(PAGE, 0.9 + 0.2 * len(_lines(table))))
        if len(table) == 0:
            return say_nothing(figure, NOTHING)
        lines = _lines(table)
        estimators = list(table.estimator.unique())
        panels = figure.subplots(1, len(SOURCES), sharey=True)
        for axes, source in zip(panels, SOURCES, strict=True):
            rows = table[table.source == source.name]
            slots = np.linspace(-0.3, 0.3, len(estimators) + 1)
            for estimator, slot, colour in zip(estimators, slots, cycle(PALETTE)):
                own = rows[rows.estimator == estimator]
                y = _places(own, lines) + slot
                axes.hlines(y, own.low, own.high, color=colour, linewidth=1)
                label = f"ours, estimator {estimator}"
                axes.plot(own.value, y, "o", color=colour, markersize=3, label=label)
            for single in (True, False):
                theirs = rows[(rows.paper_low == rows.paper_high) == single]
                y = _places(theirs, lines) + slots[-1]
                axes.hlines(y, theirs.paper_low, theirs.paper_high, color=INK, linewidth=1)
                if single:
                    axes.plot(theirs.paper_low, y, "D", color=INK, markersize=3, label="the paper")
            axes.axvline(0, color=MUTED, linewidth=0.5, zorder=-1)
            tame(axes, "x", rows[["low", "high"]].to_numpy())
            axes.set_xlabel(value_label(source, "nats"))
        names = [f"{titles.get(s, s)}, {where}" for where, s in lines]
        panels[0].set_yticks(range(len(lines)), names)
        panels[0].set_ylim(len(lines) - 0.5, -0.5)
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    return figure


def _lines(table):
    return list(dict.fromkeys(zip(table.shown_in, table.sequence, strict=True)))


def _places(rows, lines):
    return np.array(
        [lines.index(pair) for pair in zip(rows.shown_in, rows.sequence, strict=True)], dtype=float
    )
