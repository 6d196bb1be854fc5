"""How the causes act together: their Shapley interaction indices, couple by couple."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import Normalize, SymLogNorm, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import FuncFormatter

from icpshap.report import captions, words
from icpshap.report.figures.style import (
    INK,
    MUTED,
    PAGE,
    ROW,
    SMALL,
    TEXT,
    power_of_ten,
    say_nothing,
)
from icpshap.report.study import contains_zero, judged

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from icpshap.report.study import Study


MANY = 6  # causes, from which there is less room for each
LETTERS_OF_ALL = 66  # below the columns, if these leave room for the causes' names and the scale
COLOURS = matplotlib.colormaps["RdBu_r"]
PLAIN = "#F2F2F2"
RING: dict[str, Any] = {
    "marker": "o",
    "markersize": 5,
    "markerfacecolor": "none",
    "markeredgewidth": 1,
}


class Cell(NamedTuple):
    """A cell of the triangle: what it holds, and whether most intervals of it contain 0."""

    row: int
    column: int
    median: float
    unsure: bool


def interactions(table: pd.DataFrame, study: Study) -> Figure:
    """A triangle of causes by causes: medians over the instances in which both are on.

    The diagonal holds the Shapley values of the causes themselves, which are no interactions and
    have no colour of the scale.
    """
    shown = study.shown(table)
    rows = max(1, len(shown))
    figure = plt.figure(figsize=(PAGE, 1.3 + ROW * rows))
    if len(study.valued(table)) == 0:
        return say_nothing(figure, "No instance has a value.")
    if not shown:
        return say_nothing(figure, captions.NOTHING_PERTURBED)
    found = cells(table, study)
    norm = _norm([cell.median for cell in found if cell.row != cell.column])
    axes = figure.add_subplot()
    for cell in found:
        _draw(axes, cell, norm, shown)
    _name_causes(axes, shown)
    if rows > 1:
        _colour_bar(axes, norm, study)
    handles = _legend(table, study, norm if rows > 1 else None, any(cell.unsure for cell in found))
    figure.legend(handles=handles, loc="outside lower left", ncols=1, handlelength=1.2)
    return figure


def cells(table: pd.DataFrame, study: Study) -> list[Cell]:
    """The `Cell`s of the lower triangle with its diagonal, of the causes that are ever on."""
    shown = study.shown(table)
    found = []
    for row, b in enumerate(shown):
        for column, a in enumerate(shown[: row + 1]):
            name = f"phi_{a.name}" if a is b else f"interaction_{a.name}_{b.name}"
            on = study.present(table, a, b)
            unsure = contains_zero(judged(on, name), name)
            median = on[name].median() if len(on) else np.nan
            found.append(Cell(row, column, median, unsure.sum() > 0.5 * len(unsure)))
    return found


def _norm(values):
    """The colour scale, symmetric about 0: logarithmic beyond 1 where values are huge."""
    limit = np.nanmax(np.abs([*values, 0.0])) or 1.0
    if words.is_huge(values):
        return SymLogNorm(1, vmin=-limit, vmax=limit)
    return Normalize(-limit, limit)


def _draw(axes, cell, norm, shown):
    on_diagonal = cell.row == cell.column
    colour, edge = PLAIN, "white"
    if on_diagonal:
        edge = shown[cell.row].colour
    elif np.isfinite(cell.median):
        colour = COLOURS(norm(cell.median))
    corner, ink = (cell.column + 0.03, cell.row + 0.04), readable(colour)
    axes.add_patch(
        Rectangle(corner, 0.94, 0.92, facecolor=colour, edgecolor=edge, linewidth=on_diagonal)
    )
    text = words.number(cell.median).replace("-", "−") if np.isfinite(cell.median) else "–"
    centre = cell.column + 0.5, cell.row + 0.5
    size = TEXT if len(shown) < MANY else SMALL
    axes.text(*centre, text, ha="center", va="center", color=ink, fontsize=size)
    if cell.unsure:
        axes.plot(cell.column + 0.91, cell.row + 0.22, color=ink, **RING)


def readable(colour: Any) -> str:
    """Black or white, whichever stands out more from a colour (relative luminance of WCAG 2)."""
    white, ink, behind = (_luminance(c) + 0.05 for c in ("white", INK, colour))
    return "white" if white / behind > behind / ink else INK


def _luminance(colour):
    parts = np.array(to_rgb(colour))
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def _colour_bar(axes, norm, study):
    scale = plt.cm.ScalarMappable(norm, COLOURS)
    bar = axes.figure.colorbar(scale, ax=axes, aspect=8 * len(axes.get_yticks()), pad=0.02)
    if isinstance(norm, SymLogNorm):
        most = 10.0 ** np.floor(np.log10(float(norm.vmax or 1.0)))
        bar.set_ticks([-most, -1, 0, 1, most], minor=False)
        bar.ax.yaxis.set_major_formatter(FuncFormatter(power_of_ten))
    bar.set_label(f"interaction [{study.unit}]")
    bar.outline.set_visible(False)


def _name_causes(axes, shown):
    middles = np.arange(len(shown)) + 0.5
    axes.set_xlim(0, len(shown))
    axes.set_ylim(len(shown), 0)
    if len(shown) < MANY:
        room = LETTERS_OF_ALL // len(shown) - 1
        axes.set_xticks(middles, [fill(cause.title, room) for cause in shown])
    else:  # their titles have no room beside one another
        titles = [cause.title for cause in shown]
        axes.set_xticks(middles, titles, rotation=30, ha="right", rotation_mode="anchor")
    axes.set_yticks(middles, [fill(cause.title, 18) for cause in shown])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _legend(table, study, norm, has_rings):
    """What diagonal, cells and rings mean; norm: the colour scale, None without couples."""
    median = "median " * (len(table) > 1)
    own = f"diagonal: {median}φ of the cause itself [{study.unit}]"
    handles: list[Artist] = [Patch(facecolor=PLAIN, edgecolor=MUTED, linewidth=1, label=own)]
    if norm:
        both = f"below: {median}interaction of the two causes [{study.unit}]"
        both += ",\ncolours logarithmic beyond 1" * isinstance(norm, SymLogNorm)
        handles.append(Patch(facecolor=COLOURS(0.8), label=both))
    if has_rings:
        ring = "most 95 % intervals contain 0: cannot be told from zero"
        handles.append(Line2D([], [], linestyle="", color=INK, label=ring, **RING))
    return handles
