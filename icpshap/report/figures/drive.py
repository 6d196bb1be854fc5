"""Along a drive: pose error, wrong basins, f and Shapley values over the source scans."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, StrMethodFormatter

from icpshap.report import in_doubt, words
from icpshap.report.figures.style import (
    INK,
    MUTED,
    PAGE,
    SMALL,
    say_nothing,
    settle,
    symmetric_logarithmic,
)

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from icpshap.report.study import Study

PANEL, OF_CAUSES = 0.95, 1.5  # inch: of a panel, and of the last
AROUND = 1.3  # inch, above and below all of them
IN_DOUBT = "#FBE3C8"
MANY = 60  # pairs, from which dots are small
NARROW = 0.018  # of the axis: ranks nearer to each other stand above one another
LEAST_SHARE = 10  # per cent, that the axis of W goes up to
BAND = 0.18  # opacity of intervals
CHANCE: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": ":"}
MISSING: dict[str, Any] = {"linestyle": "", "color": MUTED, "markersize": 3.5, "marker": "x"}


def drive(table: pd.DataFrame, study: Study) -> Figure:
    """A panel for each number, of a table with one row for each pair of one sequence."""
    table = table.sort_values(["source", "reference"], kind="stable").reset_index(drop=True)
    panels = _panels(table, study)
    heights = [PANEL] * (len(panels) - 1) + [OF_CAUSES]
    figure = plt.figure(figsize=(PAGE, AROUND + sum(heights)))
    if len(study.valued(table)) == 0:
        return say_nothing(figure, "No pair has a value.")
    shared: dict[str, Any] = {"sharex": True, "squeeze": False, "height_ratios": heights}
    all_axes = figure.subplots(len(panels), **shared)[:, 0]
    ranks = in_doubt.ranking(table, study)
    for axes, (label, draw) in zip(all_axes, panels, strict=True):
        draw(axes, table, study)
        axes.set_ylabel(label)
    _mark_doubt(all_axes, table, ranks)
    _mark_missing(all_axes, table)
    all_axes[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    all_axes[-1].set_xlabel(f"source scan of {study.title(table.sequence.iloc[0])}")
    figure.align_ylabels(all_axes)
    figure.legend(handles=_legend(table, study), loc="outside lower left", ncols=4)
    settle(figure)
    return figure


def _panels(table, study):
    """Label and function of each panel that has anything to show."""
    panels = []
    if study.returns.samples:
        panels += [
            ("error [cm]", _error("translation_rmse", 100.0)),
            ("error [deg]", _error("rotation_rmse", np.rad2deg(1.0))),
        ]
    if table.wrong_basin_share.notna().any():
        panels.append(("W [%]", _wrong_basins))
    return [*panels, (f"f [{study.unit}]", _divergence), (f"φ [{study.unit}]", _causes)]


# --- panels ---------------------------------------------------------------------------------------


def _error(name, factor):
    def draw(axes, table, study):
        _line(axes, table, f"clean_{name}", MUTED, factor)
        _line(axes, table, name, INK, factor)
        values = factor * table[[f"clean_{name}", name]].dropna()
        if words.is_spread(values / max(values.median().median(), 1e-12)):
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        else:
            axes.set_ylim(0, 1.1 * values.max().max() or 1.0)

    return draw


def _wrong_basins(axes, table, study):
    _line(axes, table, "clean_wrong_basin_share", MUTED, 100.0)
    _line(axes, table, "wrong_basin_share", INK, 100.0, with_interval=True)
    axes.set_ylim(0, max(axes.get_ylim()[1], LEAST_SHARE))


def _divergence(axes, table, study):
    _line(axes, table, "f", INK, with_interval=True)
    if table.null_95.mean() > 0:
        axes.axhline(table.null_95.mean(), **CHANCE)
    _tame(axes, table[["f"]])


def _causes(axes, table, study):
    axes.axhline(0, color=MUTED, linewidth=0.5, zorder=-1)
    for cause in study.shown(table):
        _line(axes, table, f"phi_{cause.name}", cause.colour, with_interval=True)
    _tame(axes, table[study.phi(table)])


def _tame(axes, values):
    """An axis on which a few huge values do not hide the others."""
    if words.is_spread(values):
        symmetric_logarithmic(axes, "y")


def _line(axes, table, name, colour, factor=1.0, with_interval=False):
    """A line through the pairs with dots, broken where there is no value, and its interval."""
    many = len(table) > MANY
    axes.plot(
        table.source,
        factor * table[name],
        color=colour,
        linewidth=0.8,
        marker="o",
        markersize=1.6 if many else 3.2,
        markeredgewidth=0,
        clip_on=False,
    )
    if with_interval:
        low, high = factor * table[f"{name}_low"], factor * table[f"{name}_high"]
        axes.fill_between(table.source, low, high, color=colour, alpha=BAND, linewidth=0, zorder=1)
        if not many:  # what stands alone has no band
            axes.vlines(table.source, low, high, color=colour, alpha=0.5, linewidth=0.6, zorder=1)


# --- marks ----------------------------------------------------------------------------------------


def _mark_doubt(all_axes, table, ranks):
    """A stripe through all panels for each pair most in doubt, with its rank above."""
    width = np.ptp(table.source) or 1
    distance = np.diff(np.unique(table.source)).min(initial=width)
    half = np.clip(0.3 * distance, 0.002 * width, 0.01 * width)
    for axes in all_axes:
        for source in ranks.source:
            axes.axvspan(source - half, source + half, color=IN_DOUBT, linewidth=0, zorder=-3)
        axes.set_xlim(table.source.min() - 0.02 * width, table.source.max() + 0.02 * width)
    last: list[int] = []  # of each line of numbers the source at its right end
    for row in ranks.sort_values(["source", "rank"]).itertuples():
        free = [line for line, end in enumerate(last) if row.source - end > NARROW * width]
        line = free[0] if free else len(last)
        last[line : line + 1] = [row.source]
        all_axes[0].annotate(
            str(row.rank),
            (row.source, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2 + 8 * line),
            textcoords="offset points",
            ha="center",
            fontsize=SMALL,
        )


def _mark_missing(all_axes, table):
    """Crosses at the foot of each panel where a pair was not registered, or has no value."""
    for axes in all_axes:
        x = table.source[_missing(table)]
        axes.plot(x, np.full(len(x), 0.06), transform=axes.get_xaxis_transform(), **MISSING)


def _missing(table):
    return table.f.isna()


def _legend(table, study):
    many: dict[str, Any] = {"marker": "o", "markersize": 3.2, "linewidth": 0.8}
    handles: list[Artist] = [Line2D([], [], color=INK, label="with all causes", **many)]
    if study.returns.samples:
        handles.insert(0, Line2D([], [], color=MUTED, label="clean", **many))
    handles += [Line2D([], [], color=c.colour, label=c.title, **many) for c in study.shown(table)]
    if study.interval_over(table):
        handles.append(Patch(color=INK, alpha=BAND, linewidth=0, label="95 % interval"))
    if table.null_95.mean() > 0:
        handles.append(Line2D([], [], label="f by chance alone (95 %)", **CHANCE))
    handles.append(Patch(color=IN_DOUBT, linewidth=0, label="most in doubt, by rank"))
    if _missing(table).any():
        handles.append(Line2D([], [], label="not registered, or no value", **MISSING))
    return handles
