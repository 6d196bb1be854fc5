"""The paper's figures of Shapley values: summary, waterfall and dependence plots."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np

from icpshap.report import captions, effects, words
from icpshap.report.figures.style import (
    BAND,
    DECREASE,
    FAINT,
    INCREASE,
    INK,
    LEVELS,
    MUTED,
    NARROWING,
    PAGE,
    SMALL,
    mark_noise_floor,
    rows_height,
    say_nothing,
    tame,
    value_label,
)
from icpshap.report.study import contains_zero, judged

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from icpshap.causes.cause import Cause
    from icpshap.report.study import Study


RASTER_ABOVE = 500
MOST_STACKED = 0.36  # of a row of the summary, to either side of its middle
BINS = 150  # of the summary's axis: dots of one lie beside each other
LANE = 0.8  # of a lane of a dependence figure that dots are spread over
MOST_LABELS = 13  # lanes that all have their level below them
LETTERS = 82  # of a line of text that is as long as a figure is wide
NO_VALUE = "No instance has a value."


# --- summary --------------------------------------------------------------------------------------


def summary(table: pd.DataFrame, study: Study) -> Figure:
    """Every Shapley value of every instance, by cause (paper, summary plot)."""
    kept, shown = study.valued(table), study.shown(table)
    figure = plt.figure(figsize=(PAGE, rows_height(max(1, len(shown)))))
    if len(kept) == 0 or not shown:
        return say_nothing(figure, captions.NOTHING_PERTURBED if len(kept) else NO_VALUE)
    axes = figure.add_subplot()
    several = len(kept[[cause.name for cause in shown]].drop_duplicates()) > 1
    rows = {cause: study.present(table, cause) for cause in shown}
    values = kept[study.phi(table)].to_numpy()
    ranked = sorted(shown, key=lambda cause: rows[cause][f"phi_{cause.name}"].abs().mean())
    for row, cause in enumerate(ranked):
        _beeswarm(axes, row, rows[cause], cause, np.ptp(values), several)
    if several:
        _level_bar(figure, axes, len(shown))
    axes.set_yticks(range(len(ranked)), [_counted(table, cause, study) for cause in ranked])
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, len(ranked) - 0.4)
    axes.axvline(0, color=MUTED, linewidth=0.5, zorder=-1)
    axes.set_xlabel(f"φ, the share that a cause has of f (Shapley value) [{study.unit}]")
    tame(axes, "x", values)
    return figure


def _beeswarm(axes, row, rows, cause, span, several):
    """The values of a cause where it is on, in its row; those that lie together are stacked.

    As shap's summary plot, without the values of causes that are off, which are 0 by definition.
    """
    phi, level = rows[f"phi_{cause.name}"].to_numpy(), rows[cause.name].to_numpy()
    if several:
        colour = LEVELS(plt.Normalize(level.min(), level.max())(level)) if len(level) else None
    else:
        colour = MUTED
    y = row + _stacked(phi, span, level)
    many = len(rows) > RASTER_ABOVE
    axes.scatter(phi, y, s=6 if many else 14, c=colour, linewidths=0, rasterized=many)
    if row:
        axes.axhline(row - 0.5, color=FAINT, linewidth=0.6, zorder=-1)


def _stacked(values, span, level):
    """Places (n,) about 0 at which dots of almost equal values lie beside one another, by level."""
    bins = np.round(values / (span or 1.0) * BINS)
    places = np.zeros(len(values))
    groups = [np.flatnonzero(bins == one) for one in np.unique(bins)]
    most = max(map(len, groups), default=1)
    step = min(0.12, 2 * MOST_STACKED / max(1, most - 1))
    for group in groups:
        ordered = group[np.argsort(level[group], kind="stable")]
        places[ordered] = step * (np.arange(len(group)) - (len(group) - 1) / 2)
    return places


def _level_bar(figure, axes, rows):
    levels = plt.cm.ScalarMappable(cmap=LEVELS)
    bar = figure.colorbar(levels, ax=axes, ticks=[0, 1], aspect=10 * rows, pad=0.02)
    bar.set_ticklabels(["lowest", "highest"])
    bar.set_label("level of\nthe cause" if rows > 1 else "level", labelpad=-18)
    bar.outline.set_visible(False)
    bar.ax.tick_params(length=0)


def _counted(table, cause, study):
    """A cause's name, and for how many instances its value can be told from 0."""
    phi = f"phi_{cause.name}"
    rows = judged(study.present(table, cause), phi)
    if len(rows) == 0:
        return cause.label()
    return f"{cause.label()}\n{(~contains_zero(rows, phi)).sum():,} of {len(rows):,} ≠ 0"


# --- waterfall ------------------------------------------------------------------------------------


def waterfall(table: pd.DataFrame, study: Study) -> Figure:
    """What the uncertainty of one instance (a table of one row) is made of.

    As shap's waterfall plot, whose bounds must enclose the value: a jackknife's need not.
    """
    if len(table) != 1:
        raise ValueError(f"A waterfall plot shows one instance of one pair, found {len(table)}.")
    row, shown = table.iloc[0], study.shown(table)
    # Below the rows stand what f means, and what is marked on its axis.
    figure = plt.figure(figsize=(PAGE, rows_height(max(1, len(shown))) + 0.4))
    if len(study.valued(table)) == 0 or not shown:
        reason = f"No value: {row.reason or row.warning}" if shown else captions.NOTHING_PERTURBED
        return say_nothing(figure, reason)
    axes = figure.add_subplot()
    ranked = sorted(shown, key=lambda cause: abs(row[f"phi_{cause.name}"]))
    narrowing = effects.narrowing(table, study)
    _arrows(axes, table, ranked, narrowing)
    labels = [f"{c.title}\n{words.level(c, row[c.name])}" for c in ranked]
    narrows = "\nnarrows the spread"
    labels = [f"{text}{narrows * (c in narrowing)}" for text, c in zip(labels, ranked, strict=True)]
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(-0.6, len(labels) - 0.4)
    axes.set_xlabel(fill(f"f = {captions.meaning(study)}", LETTERS))
    title = f"f = {words.with_interval(row.f, row.f_low, row.f_high)}"
    axes.set_title(f"{'the spread shrinks: ' * bool(row.shrinks)}{title}", loc="right", pad=3)
    axes.locator_params(axis="x", nbins=8)
    _mark_chance(axes, row)
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower left", ncols=2)
    return figure


def _arrows(axes, table, ranked, narrowing):
    """An arrow for each cause from where the one below it ends, with interval and number."""
    row = table.iloc[0]
    ends = row.base_value + np.cumsum([0.0, *(row[f"phi_{cause.name}"] for cause in ranked)])
    head = 0.02 * np.ptp(ends)
    for position, cause in enumerate(ranked):
        phi, low, high = (row[f"phi_{cause.name}{part}"] for part in ("", "_low", "_high"))
        filled = not contains_zero(table, f"phi_{cause.name}")[0]
        colour = INCREASE if phi >= 0 else DECREASE
        if cause in narrowing:
            colour = NARROWING
        _arrow(axes, ends[position], position, phi, min(head, abs(phi)), filled, colour)
        interval = ends[position] + low, ends[position] + high
        axes.plot(interval, [position] * 2, color=INK, linewidth=1.2, zorder=5)
        axes.plot([ends[position + 1]] * 2, [position, position + 1], ":", color=MUTED, lw=0.6)
        axes.text(
            1.02,
            position,
            f"{'+' if phi >= 0 else ''}{words.number(phi)}\n{words.interval(low, high)}".strip(),
            transform=axes.get_yaxis_transform(),
            va="center",
            fontsize=SMALL,
        )


def _arrow(axes, start, position, phi, head, filled, colour):
    if phi == 0:  # an arrow without length has no direction
        axes.plot([start] * 2, [position - 0.35, position + 0.35], color=colour, linewidth=0.8)
        return
    axes.arrow(
        start,
        position,
        phi,
        0,
        width=0.7,
        head_width=0.7,
        head_length=head,
        length_includes_head=True,
        facecolor=colour if filled else "white",
        edgecolor=colour,
        linewidth=0.8,
        hatch=None if filled else "/////",
    )


def _mark_chance(axes, row):
    """What f is by chance, and between the two clean samples, without widening the axis for it."""
    low, high = axes.get_xlim()
    mark_noise_floor(axes.axvspan, row.null_95)
    if np.isfinite(row.f_again):
        label = f"A/A value: f between two clean samples, {words.number(row.f_again)}"
        label += "" if low <= row.f_again <= high else " (off the axis)"
        axes.axvline(row.f_again, color=INK, linewidth=0.8, linestyle=":", label=label)
        axes.set_xlim(low, high)


# --- dependence -----------------------------------------------------------------------------------


def dependence(table: pd.DataFrame, study: Study, cause: Cause, other: Cause) -> Figure:
    """The Shapley value of a cause over its own value, coloured by the value of another.

    Each level has a lane of its own, in which the dots lie side by side by `other`: on an axis of
    numbers they would be read as other levels. shap's scatter plot hides their order.
    """
    kept = study.valued(table)
    figure = plt.figure(figsize=(PAGE, 3.2))
    if len(kept) == 0:
        return say_nothing(figure, NO_VALUE)
    for needed in (cause, other):
        if needed not in study.shown(table):
            return say_nothing(figure, f"{needed.title} is never on.")
    axes = figure.add_subplot()
    colours = plt.Normalize(kept[other.name].min(), kept[other.name].max())
    _lanes(axes, np.unique(kept[cause.name]))
    _band(axes, kept, cause)
    _dots(axes, kept, cause, other, colours)
    axes.axhline(0, color=MUTED, linewidth=0.5, zorder=-1)
    axes.set_xlabel(f"{cause.label()}: a lane for each level")
    axes.set_ylabel(value_label(cause, study.unit))
    tame(axes, "y", kept[f"phi_{cause.name}"].to_numpy())
    bar = figure.colorbar(plt.cm.ScalarMappable(colours, LEVELS), ax=axes, aspect=30, pad=0.02)
    bar.set_label(other.label())
    bar.outline.set_visible(False)
    return figure


def _lanes(axes, levels):
    """A lane for each level, with the level below it."""
    for lane in range(0, len(levels), 2):
        axes.axvspan(lane - 0.5, lane + 0.5, color=BAND, linewidth=0, zorder=-3)
    step = -(-len(levels) // MOST_LABELS)
    axes.set_xticks(range(0, len(levels), step), [f"{level:g}" for level in levels[::step]])
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.5, len(levels) - 0.5)


def _band(axes, kept, cause):
    """Of each level: median, central 90 %, and medians of the intervals' ends."""
    phi = f"phi_{cause.name}"
    groups = kept.groupby(cause.name)
    quantiles = groups[phi].quantile([0.05, 0.5, 0.95]).unstack()
    lanes = np.arange(len(quantiles))
    low, high = quantiles[0.05], quantiles[0.95]
    axes.bar(lanes, high - low, LANE, bottom=low, color=FAINT, linewidth=0, zorder=0)
    ends = groups[[f"{phi}_low", f"{phi}_high"]].median()
    axes.vlines(lanes, ends.iloc[:, 0], ends.iloc[:, 1], color=INK, linewidth=0.8, zorder=4)
    look = {"linewidth": 0.8, "marker": "_", "markersize": 12, "markeredgewidth": 1.4, "zorder": 4}
    axes.plot(lanes, quantiles[0.5], color=INK, **look)


def _dots(axes, kept, cause, other, colours):
    """A dot for each instance in the lane of its level, open where its interval contains 0."""
    _, lane = np.unique(kept[cause.name], return_inverse=True)
    others, place = np.unique(kept[other.name], return_inverse=True)
    x = lane + LANE * ((place + 0.5) / len(others) - 0.5)
    y = kept[f"phi_{cause.name}"].to_numpy()
    unsure = contains_zero(kept, f"phi_{cause.name}")
    many = len(kept) > RASTER_ABOVE
    for rows, closed in ((~unsure, True), (unsure, False)):
        shade = LEVELS(colours(kept[other.name].to_numpy()[rows]))
        axes.scatter(
            x[rows],
            y[rows],
            s=8 if many else 18,
            facecolors=shade if closed else "none",
            edgecolors=shade,
            linewidths=0.7,
            rasterized=many,
        )
