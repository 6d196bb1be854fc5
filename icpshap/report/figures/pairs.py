"""Shapley values and f pair by pair, in strips below one another."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np

from icpshap.report import words
from icpshap.report.figures.style import (
    FAINT,
    INK,
    MUTED,
    PAGE,
    SMALL,
    mark_noise_floor,
    say_nothing,
    symmetric_logarithmic,
    value_label,
)
from icpshap.report.study import contains_zero

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from icpshap.report.study import Study


# Tables with at most this many rows name every pair; larger ones name the sequences.
FEW = 8
LETTERS = 18  # of an axis label that are as long as a strip is high
LETTERS_OF_ALL = 80  # below the strips
AGAIN = "#CC79A7"


def pairs(table: pd.DataFrame, study: Study) -> Figure:
    """Shapley values and f of every instance, pair by pair and sequence by sequence."""
    table = table.reset_index(drop=True)
    strips = [
        *((f"phi_{c.name}", value_label(c, study.unit), c.colour) for c in study.shown(table)),
        ("f", f"f [{study.unit}]", INK),
    ]
    figure = plt.figure(figsize=(PAGE, 0.7 + 1.15 * len(strips)))
    if len(study.valued(table)) == 0:
        return say_nothing(figure, "No pair has a value.")
    panels = figure.subplots(len(strips), sharex=True, squeeze=False)[:, 0]
    x = _positions(table)
    logarithmic = words.is_spread(table[[*study.phi(table), "f"]])
    for axes, (name, label, colour) in zip(panels, strips, strict=True):
        _strip(axes, x, table, name, colour, logarithmic)
        axes.set_ylabel(fill(label, LETTERS, break_long_words=False))
    _name_rows(panels[-1], x, table, study)
    figure.align_ylabels(panels)
    _mark_chance(panels[-1], x, table)
    handles = panels[-1].get_legend_handles_labels()
    if handles[0]:
        figure.legend(*handles, loc="outside lower right", ncols=3)
    return figure


def _positions(table):
    """Where the rows stand on the x axis, with a gap between sequences."""
    return np.arange(len(table)) + 2 * table.sequence.map(list(table.sequence.unique()).index)


def _strip(axes, x, table, name, colour, logarithmic):
    """Dots with intervals, the median of each sequence, and marks where there is no value."""
    _estimates(axes, x, table, name, colour)
    for _, rows in table.groupby("sequence", sort=False):
        ends = x[rows.index].min() - 0.5, x[rows.index].max() + 0.5
        axes.plot(ends, [rows[name].median()] * 2, color=colour, linewidth=1.5)
        axes.axvline(ends[0] - 1, color=FAINT, linewidth=0.6, zorder=-2)
    _mark_missing(axes, x[table[name].isna()])
    axes.axhline(0, color=MUTED, linewidth=0.5, zorder=-1)
    if logarithmic:
        symmetric_logarithmic(axes, "y")
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, -0.3), max(high, 1.2))


def _estimates(axes, x, table, name, colour):
    """Dots with intervals, open where 0 is in them."""
    many = len(table) > FEW
    low, high = table[f"{name}_low"], table[f"{name}_high"]
    axes.vlines(x, low, high, color=colour, linewidth=0.5 if many else 1.4, alpha=0.6)
    unsure = contains_zero(table, name)
    for rows, face in ((~unsure, colour), (unsure, "white")):
        axes.plot(
            x[rows],
            table[name][rows],
            "o",
            markersize=2.2 if many else 5,
            markerfacecolor=face,
            markeredgecolor=colour,
            markeredgewidth=0.6,
        )


def _mark_missing(axes, x):
    if len(x):
        axes.plot(
            x,
            np.full(len(x), 0.06),
            "x",
            color=MUTED,
            markersize=3,
            transform=axes.get_xaxis_transform(),
            label="no value",
        )


def _name_rows(axes, x, table, study):
    if len(table) <= FEW:
        room = int(LETTERS_OF_ALL / (np.ptp(x) + 2.5))
        names = [study.pair(row) for row in table.itertuples()]
        labels = [fill(name, room, break_long_words=False) for name in names]
        axes.set_xticks(x, labels, fontsize=SMALL)
    else:
        starts = table.groupby("sequence", sort=False).head(1)
        names = [study.title(sequence).replace(" ", "\n") for sequence in starts.sequence]
        axes.set_xticks(x[starts.index], names, ha="left")
    axes.set_xlim(x.min() - 1.5, x.max() + 1)


def _mark_chance(axes, x, table):
    """What f is by chance, and between two clean samples of a pair."""
    mark_noise_floor(axes.axhspan, table.null_95.mean())
    if table.f_again.notna().any():
        label = "A/A value: f between two clean samples"
        axes.plot(x, table.f_again, "_", color=AGAIN, markersize=7, label=label)
