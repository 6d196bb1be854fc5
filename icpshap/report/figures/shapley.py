"""The paper's figures of Shapley values: summary, waterfall and dependence plots."""

import matplotlib.pyplot as plt
import numpy as np

from icpshap.report import captions, effects, words
from icpshap.report.figures.style import (
    COLUMN,
    DECREASE,
    FAINT,
    INCREASE,
    INK,
    LEVELS,
    MUTED,
    NARROWING,
    mark_noise_floor,
    rows_height,
    say_nothing,
    tame,
    value_label,
)
from icpshap.report.study import contains_zero, judged

RASTER_ABOVE = 500
NO_VALUE = "No instance has a value."


# --- summary --------------------------------------------------------------------------------------


def summary(table, study):
    """Every Shapley value of every instance, by cause (paper, summary plot)."""
    kept, shown = study.valued(table), study.shown(table)
    figure = plt.figure(figsize=(COLUMN, rows_height(max(1, len(shown)))))
    if len(kept) == 0 or not shown:
        return say_nothing(figure, captions.NOTHING_PERTURBED if len(kept) else NO_VALUE)
    axes = figure.add_subplot()
    several = len(kept[[cause.name for cause in shown]].drop_duplicates()) > 1
    _beeswarm(axes, kept, shown, LEVELS if several else MUTED)
    if several:
        _level_bar(figure, axes, len(shown))
    by_name = {cause.name: cause for cause in shown}
    ranked = [by_name[text.get_text()] for text in axes.get_yticklabels()]
    axes.set_yticks(range(len(ranked)), [_counted(table, cause, study) for cause in ranked])
    axes.tick_params(axis="both", labelsize=6.5)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(-0.6, len(ranked) - 0.4)
    axes.set_xlabel(f"Shapley value φ [{study.unit}]", fontsize=7)
    tame(axes, "x", kept[study.phi(table)].to_numpy())
    return figure


def _beeswarm(axes, kept, shown, colour):
    import shap  # takes seconds, which the other figures need not wait for

    shap.plots.beeswarm(
        shap.Explanation(
            values=kept[[f"phi_{cause.name}" for cause in shown]].to_numpy(),
            base_values=kept["base_value"].to_numpy(),
            data=kept[[cause.name for cause in shown]].to_numpy(),
            feature_names=[cause.name for cause in shown],
        ),
        ax=axes,
        color=colour,
        color_bar=False,
        s=5,
        plot_size=None,
        show=False,
    )


def _level_bar(figure, axes, rows):
    levels = plt.cm.ScalarMappable(cmap=LEVELS)
    bar = figure.colorbar(levels, ax=axes, ticks=[0, 1], aspect=10 * rows, pad=0.02)
    bar.set_ticklabels(["low", "high"])
    bar.set_label("value of the cause" if rows > 2 else "value", labelpad=-8)
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


def waterfall(table, study):
    """What the uncertainty of one instance (a table of one row) is made of.

    As shap's waterfall plot, whose bounds must enclose the value: a jackknife's need not.
    """
    if len(table) != 1:
        raise ValueError(f"A waterfall plot shows one instance of one pair, found {len(table)}.")
    row, shown = table.iloc[0], study.shown(table)
    figure = plt.figure(figsize=(COLUMN, rows_height(max(1, len(shown)))))
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
    axes.set_yticks(range(len(labels)), labels, fontsize=7)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_ylim(-0.6, len(labels) - 0.4)
    axes.set_xlabel(f"f, {captions.reading(study)}")
    title = f"f = {words.with_interval(row.f, row.f_low, row.f_high)}"
    axes.set_title(f"{'the spread shrinks: ' * bool(row.shrinks)}{title}", loc="right", pad=3)
    axes.locator_params(axis="x", nbins=5)
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
            fontsize=6.5,
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
        label = f"A/A value, {words.number(row.f_again)}"
        label += "" if low <= row.f_again <= high else " (off the axis)"
        axes.axvline(row.f_again, color=INK, linewidth=0.8, linestyle=":", label=label)
        axes.set_xlim(low, high)


# --- dependence -----------------------------------------------------------------------------------


def dependence(table, study, cause, other):
    """The Shapley value of a cause over its own value, coloured by the value of another.

    shap's scatter plot shows few levels of `other` as two colours and hides the order within a
    level; here the dots of a level lie side by side by `other`.
    """
    kept = study.valued(table)
    figure = plt.figure(figsize=(COLUMN, 2.5))
    if len(kept) == 0:
        return say_nothing(figure, NO_VALUE)
    for needed in (cause, other):
        if needed not in study.shown(table):
            return say_nothing(figure, f"{needed.title} is never on.")
    axes = figure.add_subplot()
    colours = plt.Normalize(kept[other.name].min(), kept[other.name].max())
    _band(axes, kept, cause)
    _dots(axes, kept, cause, other, colours)
    axes.axhline(0, color=MUTED, linewidth=0.5, zorder=-1)
    axes.set_xlabel(cause.label())
    axes.locator_params(axis="x", nbins=6)
    axes.set_ylabel(value_label(cause, study.unit))
    tame(axes, "y", kept[f"phi_{cause.name}"].to_numpy())
    bar = figure.colorbar(plt.cm.ScalarMappable(colours, LEVELS), ax=axes, aspect=30, pad=0.02)
    bar.set_label(other.label())
    bar.outline.set_visible(False)
    return figure


def _band(axes, kept, cause):
    """Of each level: median, central 90 %, and medians of the intervals' ends."""
    phi = f"phi_{cause.name}"
    groups = kept.groupby(cause.name)
    quantiles = groups[phi].quantile([0.05, 0.5, 0.95]).unstack()
    levels = quantiles.index.to_numpy()
    axes.fill_between(levels, quantiles[0.05], quantiles[0.95], color=FAINT, linewidth=0, zorder=0)
    ends = groups[[f"{phi}_low", f"{phi}_high"]].median()
    axes.vlines(levels, ends.iloc[:, 0], ends.iloc[:, 1], color=INK, linewidth=0.8, zorder=4)
    axes.plot(levels, quantiles[0.5], color=INK, linewidth=1.0, marker="_", markersize=5, zorder=4)


def _dots(axes, kept, cause, other, colours):
    """A dot for each instance, open where its interval contains 0."""
    level, of_other = kept[cause.name].to_numpy(), kept[other.name].to_numpy()
    levels = np.unique(level)
    gap = np.diff(levels).min() if len(levels) > 1 else 0.0
    middle, span = (of_other.min() + of_other.max()) / 2, np.ptp(of_other) or 1.0
    x, y = level + 0.6 * gap * (of_other - middle) / span, kept[f"phi_{cause.name}"].to_numpy()
    unsure = contains_zero(kept, f"phi_{cause.name}")
    many = len(kept) > RASTER_ABOVE
    for rows, closed in ((~unsure, True), (unsure, False)):
        shade = LEVELS(colours(of_other[rows]))
        axes.scatter(
            x[rows],
            y[rows],
            s=5 if many else 10,
            facecolors=shade if closed else "none",
            edgecolors=shade,
            linewidths=0.4,
            rasterized=many,
        )
