"""Several estimators side by side: a row for each, a panel for each cause and for f."""

from __future__ import annotations

from math import ceil
from textwrap import fill
from typing import TYPE_CHECKING, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from icpshap.report import by_estimator, captions
from icpshap.report.figures.style import (
    BAND,
    INK,
    MUTED,
    PAGE,
    SMALL,
    say_nothing,
    styled,
    symmetric_logarithmic,
)
from icpshap.report.study import contains_zero

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from icpshap.report.study import Study


MOST_IN_A_ROW = 2  # panels
ROW, AROUND = 0.3, 0.55  # inch: of an estimator, and of what is above and below all of them
LETTERS = 36  # of a title that are as long as a panel is wide
LINEAR = 0.1  # up to here the axes are linear
MARK = {"linestyle": "", "markersize": 5, "markeredgewidth": 1}
DOT = {"linestyle": "", "markersize": 3, "markeredgewidth": 0}
MEDIAN = {"marker": "|", "markersize": 9, "markeredgewidth": 1.6}
ALPHA = 0.6  # of the dots that a median is of


class Panel(NamedTuple):
    """A number of the table: its column, its title and its colour, and the rows in which it is."""

    column: str
    title: str
    colour: str
    rows: object


def picture(table: pd.DataFrame, study: Study) -> Figure:
    """Shapley values and f of a `by_estimator` table, on axes that all panels share."""
    names = by_estimator.estimators(table)
    shown = study.shown(table)
    panels = [
        Panel(f"phi_{c.name}", f"φ {c.title}", c.colour, study.present(table, c)) for c in shown
    ]
    panels.append(Panel("f", "f", INK, study.valued(table)))
    lines = ceil(len(panels) / MOST_IN_A_ROW)
    with styled():
        figure = plt.figure(figsize=(PAGE, 0.3 + lines * (AROUND + ROW * len(names))))
        if not shown:
            return say_nothing(figure, captions.NOTHING_PERTURBED)
        if len(study.valued(table)) == 0:
            return say_nothing(figure, "No estimator has a value.")
        columns = min(len(panels), MOST_IN_A_ROW)
        all_axes = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False).ravel()
        for axes in all_axes[len(panels) :]:
            axes.set_axis_off()
        kinds = [_draw(axes, panel, names) for axes, panel in zip(all_axes, panels, strict=False)]
        symmetric_logarithmic(all_axes[0], "x", LINEAR)
        for axes, panel in zip(all_axes, panels, strict=False):
            axes.tick_params(axis="x", labelbottom=True, labelsize=SMALL)
            axes.tick_params(axis="y", labelsize=SMALL)
            axes.set_xlabel(fill(f"{panel.title} [{study.unit}]", LETTERS))
        _name(all_axes[0], table, names)
        figure.legend(
            handles=[handle for kind, handle in HANDLES.items() if kind in set().union(*kinds)],
            loc="outside lower right",
            ncols=3,
        )
    return figure


def _draw(axes, panel, names):
    """The rows of a panel; which kinds of marks there are."""
    for row in range(0, len(names), 2):
        axes.axhspan(row - 0.5, row + 0.5, color=BAND, linewidth=0, zorder=-3)
    axes.axvline(0, color=MUTED, linewidth=0.5, zorder=-1)
    axes.tick_params(axis="y", length=0)
    kinds = set()
    for y, name in enumerate(names):
        rows = panel.rows[panel.rows.estimator == name]
        if len(rows) == 0:
            axes.plot(0.5, y, "x", color=MUTED, transform=axes.get_yaxis_transform(), **MARK)
            kinds.add("no value")
        elif len(rows) == 1:
            kinds.add(_estimate(axes, y, rows, panel))
        else:
            kinds |= _several(axes, y, rows[panel.column], panel.colour)
    return kinds


def _estimate(axes, y, row, panel):
    """One number with its interval; the kind of its mark."""
    low, high = (row[f"{panel.column}_{end}"].item() for end in ("low", "high"))
    if np.isnan(low) or np.isnan(high):
        kind = "no interval"
    else:
        axes.hlines(y, low, high, color=panel.colour, linewidth=1.2)
        kind = "unsure" if contains_zero(row, panel.column).item() else "sure"
    axes.plot(row[panel.column], [y], color=panel.colour, **_mark(kind, panel.colour))
    return kind


def _several(axes, y, values, colour):
    """The dots of instances, and their median."""
    axes.plot(values, np.full(len(values), y), color=colour, alpha=ALPHA, marker="o", **DOT)
    axes.plot(values.median(), y, color=colour, linestyle="", **MEDIAN)
    return {"instance", "median"}


def _mark(kind, colour):
    """How a number is drawn."""
    face = "white" if kind == "unsure" else colour
    return {"marker": "D" if kind == "no interval" else "o", "markerfacecolor": face, **MARK}


def _legend(label, **drawn):
    return Line2D([], [], color=MUTED, label=label, **drawn)


HANDLES = {
    "sure": _legend("with 95 % interval", **_mark("sure", MUTED)),
    "unsure": _legend("95 % interval contains 0", **_mark("unsure", MUTED)),
    "no interval": _legend("no interval", **_mark("no interval", MUTED)),
    "instance": _legend("instance", marker="o", **DOT),
    "median": _legend("median", linestyle="", **MEDIAN),
    "no value": _legend("no value", marker="x", **MARK),
}


def _name(axes, table, names):
    """Names of the estimators, and below each what noise it was told."""
    told = table.groupby("estimator").told.first()
    labels = [f"{name}\ntold {told[name]}" if told[name] else name for name in names]
    axes.set_yticks(range(len(names)), labels)
    axes.set_ylim(len(names) - 0.5, -0.5)
