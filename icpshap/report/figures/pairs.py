"""Figures pair by pair, and of interactions."""

import matplotlib.pyplot as plt
import numpy as np

from icpshap.causes import NAMES, SOURCES
from icpshap.explanation import shapley
from icpshap.report import captions
from icpshap.report.figures.style import (
    COLOURS,
    COLUMN,
    FAINT,
    INK,
    MUTED,
    PAGE,
    mark_noise_floor,
    say_nothing,
    symmetric_logarithmic,
    value_label,
)

BY_NAME = {source.name: source for source in SOURCES}
# Tables with at most this many rows name every pair; larger ones name the sequences.
FEW = 8
INTERACTIONS = [(a, b, f"interaction_{a}_{b}") for a, b in shapley.pairs(NAMES)]
AGAIN = "#CC79A7"


def pairs(table, study):
    """Shapley values and f of every instance, pair by pair and sequence by sequence."""
    panels = [(f"phi_{s.name}", value_label(s, study.unit), COLOURS[s.name]) for s in SOURCES]
    figure = _strips(table, [*panels, ("f", f"f [{study.unit}]", INK)], study)
    if len(captions.valued(table)):
        axes = figure.axes[-1]
        mark_noise_floor(axes.axhspan, table.null_95.mean())
        x = _positions(table)
        axes.plot(x, table.f_again, "_", color=AGAIN, markersize=4, label="A/A value")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=3)
    return figure


def interactions(table, study):
    """Interaction indices of every two sources: a map over their levels, or pair by pair."""
    kept = captions.valued(table)
    if len(kept[list(NAMES)].drop_duplicates()) > 1:
        return _interaction_maps(kept, study)
    panels = [
        (name, f"{BY_NAME[a].title} ×\n{BY_NAME[b].title} [{study.unit}]", INK)
        for a, b, name in INTERACTIONS
    ]
    return _strips(table, panels, study)


def _positions(table):
    """Where the rows stand on the x axis, with a gap between sequences."""
    return np.arange(len(table)) + 2 * table.sequence.map(list(table.sequence.unique()).index)


def _strips(table, columns, study):
    """A panel for each (column, label, colour): dots with intervals, open where 0 is in them."""
    table = table.reset_index(drop=True)
    few = len(table) <= FEW
    figure = plt.figure(figsize=(COLUMN if few else PAGE, 0.5 + 1.05 * len(columns)))
    if len(captions.valued(table)) == 0:
        return say_nothing(figure, "No pair has a value.")
    panels = figure.subplots(len(columns), sharex=True)
    x = _positions(table)
    sequences = table.groupby("sequence", sort=False)
    for axes, (name, label, colour) in zip(panels, columns, strict=True):
        _estimates(axes, x, table, name, colour)
        for _, rows in sequences:
            ends = x[rows.index].min() - 0.5, x[rows.index].max() + 0.5
            axes.plot(ends, [rows[name].median()] * 2, color=colour, linewidth=1.5)
            axes.axvline(ends[0] - 1, color=FAINT, linewidth=0.6, zorder=-2)
        missing = x[table[name].isna()]
        if len(missing):
            bottom = axes.get_xaxis_transform()
            axes.plot(
                missing,
                np.full(len(missing), 0.06),
                "x",
                color=MUTED,
                markersize=3,
                transform=bottom,
                label="no value",
            )
        axes.axhline(0, color=MUTED, linewidth=0.5, zorder=-1)
        symmetric_logarithmic(axes, "y")
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -0.3), max(high, 1.2))
        axes.set_ylabel(label.replace(" [", "\n["))
    if few:
        labels = [study.pair(row) for row in table.itertuples()]
        axes.set_xticks(x, labels, rotation=20, ha="right")
    else:
        starts = sequences.head(1)
        titles = [study.title(sequence).replace(" ", "\n") for sequence in starts.sequence]
        axes.set_xticks(x[starts.index], titles, ha="left")
    axes.set_xlim(x.min() - 1.5, x.max() + 1)
    figure.align_ylabels(panels)
    return figure


def _estimates(axes, x, table, name, colour):
    low, high = table[f"{name}_low"], table[f"{name}_high"]
    many = len(table) > FEW
    axes.vlines(x, low, high, color=colour, linewidth=0.5 if many else 0.9, alpha=0.6)
    significant = (low > 0) | (high < 0)
    for rows, face in ((significant, colour), (~significant, "white")):
        axes.plot(
            x[rows],
            table[name][rows],
            "o",
            markersize=2.2 if many else 3.5,
            markerfacecolor=face,
            markeredgecolor=colour,
            markeredgewidth=0.6,
        )


def _interaction_maps(kept, study):
    """Median over the levels of the third source; a dot where most intervals hold 0."""
    figure = plt.figure(figsize=(PAGE, 2.3))
    medians = {
        name: kept.pivot_table(columns=a, index=b, values=name, aggfunc="median")
        for a, b, name in INTERACTIONS
    }
    limit = max(np.abs(grid.to_numpy()).max() for grid in medians.values()) or 1.0
    for axes, (a, b, name) in zip(figure.subplots(1, len(INTERACTIONS)), INTERACTIONS, strict=True):
        grid = medians[name]
        image = axes.pcolormesh(grid, cmap="RdBu_r", vmin=-limit, vmax=limit)
        unsure = kept.assign(unsure=(kept[f"{name}_low"] <= 0) & (kept[f"{name}_high"] >= 0))
        share = unsure.pivot_table(columns=a, index=b, values="unsure", aggfunc="mean")
        rows, columns = np.nonzero(share.to_numpy() >= 0.5)
        axes.plot(columns + 0.5, rows + 0.5, ".", color=MUTED, markersize=2)
        for axis, levels, source in (
            (axes.xaxis, grid.columns, BY_NAME[a]),
            (axes.yaxis, grid.index, BY_NAME[b]),
        ):
            shown = range(0, len(levels), max(1, (len(levels) - 1) // 2))
            axis.set_ticks([k + 0.5 for k in shown], [f"{levels[k]:g}" for k in shown])
            axis.set_label_text(source.label)
    figure.colorbar(image, ax=figure.axes, label=f"interaction [{study.unit}]", aspect=30, pad=0.01)
    return figure
