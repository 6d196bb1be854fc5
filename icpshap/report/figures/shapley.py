"""The paper's figures of Shapley values: summary, waterfall and dependence plots."""

import matplotlib.pyplot as plt
import numpy as np

from icpshap.causes import NAMES, SOURCES
from icpshap.report import captions
from icpshap.report.figures.style import (
    COLUMN,
    DECREASE,
    FAINT,
    INCREASE,
    INK,
    LEVELS,
    MUTED,
    mark_noise_floor,
    say_nothing,
    tame,
    value_label,
)

RASTER_ABOVE = 500


def summary(table, study):
    """Every Shapley value of every instance, by source (paper, summary plot)."""
    kept = captions.valued(table)
    figure = plt.figure(figsize=(COLUMN, 1.9))
    if len(kept) == 0:
        return say_nothing(figure, "No instance has a value.")
    import shap  # takes seconds, which the other figures need not wait for

    axes = figure.add_subplot()
    several = len(kept[list(NAMES)].drop_duplicates()) > 1
    shap.plots.beeswarm(
        shap.Explanation(
            values=kept[[f"phi_{source.name}" for source in SOURCES]].to_numpy(),
            base_values=kept["base_value"].to_numpy(),
            data=kept[list(NAMES)].to_numpy(),
            feature_names=[source.label for source in SOURCES],
        ),
        ax=axes,
        color=LEVELS if several else MUTED,
        color_bar=False,
        s=5,
        plot_size=None,
        show=False,
    )
    if several:
        bar = figure.colorbar(
            plt.cm.ScalarMappable(cmap=LEVELS), ax=axes, ticks=[0, 1], aspect=30, pad=0.02
        )
        bar.set_ticklabels(["low", "high"])
        bar.set_label("value of the source", labelpad=-8)
        bar.outline.set_visible(False)
        bar.ax.tick_params(length=0)
    titles = {source.label: source for source in SOURCES}
    labels = [titles[text.get_text()] for text in axes.get_yticklabels()]
    axes.set_yticks(range(len(labels)), [_counted(table, source) for source in labels])
    axes.tick_params(axis="both", labelsize=6.5)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, len(labels) - 0.4)
    axes.set_xlabel(f"Shapley value φ [{study.unit}]", fontsize=7)
    tame(axes, "x", kept[[f"phi_{name}" for name in NAMES]].to_numpy())
    return figure


def _counted(table, source):
    """A source's name, and for how many instances its value can be told from 0."""
    rows = captions.present(table, source)
    significant = rows[f"phi_{source.name}_significant"].astype(bool).sum()
    return f"{source.label}\n{significant:,} of {len(rows):,} ≠ 0"


def waterfall(table, study):
    """What the uncertainty of one instance (a table of one row) is made of.

    As shap's waterfall plot, whose bounds must enclose the value: a jackknife's need not.
    """
    if len(table) != 1:
        raise ValueError(f"A waterfall plot shows one instance of one pair, found {len(table)}.")
    row = table.iloc[0]
    figure = plt.figure(figsize=(COLUMN, 1.9))
    if len(captions.valued(table)) == 0:
        return say_nothing(figure, f"No value: {row.reason or row.warning}")
    axes = figure.add_subplot()
    ranked = sorted(SOURCES, key=lambda source: abs(row[f"phi_{source.name}"]))
    ends = row.base_value + np.cumsum([0.0, *(row[f"phi_{source.name}"] for source in ranked)])
    head = 0.02 * np.ptp(ends)
    for position, source in enumerate(ranked):
        phi, low, high = (row[f"phi_{source.name}{part}"] for part in ("", "_low", "_high"))
        colour = INCREASE if phi >= 0 else DECREASE
        significant = row[f"phi_{source.name}_significant"]
        axes.arrow(
            ends[position],
            position,
            phi,
            0,
            width=0.7,
            head_width=0.7,
            head_length=min(head, abs(phi)),
            length_includes_head=True,
            facecolor=colour if significant else "white",
            edgecolor=colour,
            linewidth=0.8,
            hatch=None if significant else "/////",
        )
        interval = ends[position] + low, ends[position] + high
        axes.plot(interval, [position] * 2, color=INK, linewidth=1.2, zorder=5)
        axes.plot([ends[position + 1]] * 2, [position, position + 1], ":", color=MUTED, lw=0.6)
        axes.text(
            1.02,
            position,
            f"{'+' if phi >= 0 else ''}{captions.number(phi)}\n{captions.interval(low, high)}",
            transform=axes.get_yaxis_transform(),
            va="center",
            fontsize=6.5,
        )
    labels = [
        f"{source.title}\n{source.symbol} = {row[source.name]:g} {source.unit}".strip()
        for source in ranked
    ]
    axes.set_yticks(range(len(labels)), labels, fontsize=7)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(-0.6, len(labels) - 0.4)
    axes.set_xlabel(f"f, {captions.reading(study)}")
    title = f"f = {captions.number(row.f)} {captions.interval(row.f_low, row.f_high)}"
    axes.set_title(title, loc="right", pad=3)
    axes.locator_params(axis="x", nbins=5)
    low, high = axes.get_xlim()
    mark_noise_floor(axes.axvspan, row.null_95)
    if np.isfinite(row.f_again):
        label = f"A/A value, {captions.number(row.f_again)}"
        label += "" if low <= row.f_again <= high else " (off the axis)"
        axes.axvline(row.f_again, color=INK, linewidth=0.8, linestyle=":", label=label)
        axes.set_xlim(low, high)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower left", ncols=2)
    return figure


def dependence(table, study, source, other):
    """The Shapley value of `source` over its own value, coloured by the value of `other`.

    shap's scatter plot shows few levels of `other` as two colours and hides the order within a
    level; here the dots of a level lie side by side by `other`.
    """
    kept = captions.valued(table)
    figure = plt.figure(figsize=(COLUMN, 2.5))
    if len(kept) == 0:
        return say_nothing(figure, "No instance has a value.")
    axes = figure.add_subplot()
    phi = f"phi_{source.name}"
    level, of_other = kept[source.name].to_numpy(), kept[other.name].to_numpy()
    levels = np.unique(level)
    gap = np.diff(levels).min() if len(levels) > 1 else 0.0
    middle, span = (of_other.min() + of_other.max()) / 2, np.ptp(of_other) or 1.0
    x = level + 0.6 * gap * (of_other - middle) / span

    groups = kept.groupby(source.name)
    quantiles = groups[phi].quantile([0.05, 0.5, 0.95]).unstack()
    axes.fill_between(levels, quantiles[0.05], quantiles[0.95], color=FAINT, linewidth=0, zorder=0)
    significant = kept[f"{phi}_significant"].to_numpy(dtype=bool)
    colours = plt.Normalize(of_other.min(), of_other.max())
    size = 5 if len(kept) > RASTER_ABOVE else 10
    for rows, face in ((significant, True), (~significant, False)):
        shade = LEVELS(colours(of_other[rows]))
        axes.scatter(
            x[rows],
            kept[phi].to_numpy()[rows],
            s=size,
            facecolors=shade if face else "none",
            edgecolors=shade,
            linewidths=0.4,
            rasterized=len(kept) > RASTER_ABOVE,
        )
    ends = groups[[f"{phi}_low", f"{phi}_high"]].median()
    axes.vlines(levels, ends.iloc[:, 0], ends.iloc[:, 1], color=INK, linewidth=0.8, zorder=4)
    axes.plot(levels, quantiles[0.5], color=INK, linewidth=1.0, marker="_", markersize=5, zorder=4)
    axes.axhline(0, color=MUTED, linewidth=0.5, zorder=-1)
    axes.set_xlabel(source.label)
    axes.set_ylabel(value_label(source, study.unit))
    tame(axes, "y", kept[phi].to_numpy())
    bar = figure.colorbar(plt.cm.ScalarMappable(colours, LEVELS), ax=axes, aspect=30, pad=0.02)
    bar.set_label(other.label)
    bar.outline.set_visible(False)
    return figure
