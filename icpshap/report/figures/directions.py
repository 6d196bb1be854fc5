"""Which cause makes which direction uncertain: directions by causes."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from icpshap.report import captions, directions, words
from icpshap.report.figures.couples import PLAIN, RING, readable
from icpshap.report.figures.style import AROUND_ROWS, INK, PAGE, ROW, SMALL, TEXT, say_nothing

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from icpshap.report.study import Study


COLOURS = matplotlib.colormaps["RdBu_r"]
PALEST = 0.85  # of the colour scale's range, so that numbers stay readable
MANY = 5  # causes, from which there is less room for each
LAST = 1.9  # cells that the last column is as wide as
REMAINS = "→ standard deviation, or root mean square error, without the cause [cm, deg]"
UNSURE = "most 95 % intervals contain 0: cannot be told from zero"


def picture(table: pd.DataFrame, study: Study) -> Figure:
    """Variances of the directions, and what each cause adds; a directions table of one scope.

    Of several instances the medians. A cell is coloured by its part of all parts of its row; below
    the part stands the standard deviation that remains without the cause.
    """
    shown, rows = study.shown(table), directions.summary(table, study)
    figure = plt.figure(figsize=(PAGE, AROUND_ROWS + 0.5 + 0.9 * ROW * max(1, len(rows))))
    if not shown:
        return say_nothing(figure, captions.NOTHING_PERTURBED)
    if not rows:
        return say_nothing(figure, "No instance has a value.")
    axes = figure.add_subplot()
    for y, row in enumerate(rows):
        _draw(axes, y, row, shown)
    many = len(shown) >= MANY
    columns = ["clean", *(cause.title if many else fill(cause.title, 14) for cause in shown)]
    columns += ["in all", "deviation" if many else "standard\ndeviation"]
    places = np.append(np.arange(len(columns) - 1) + 0.5, len(columns) - 1 + LAST / 2)
    # The titles of many causes have no room beside one another.
    slanted: dict[str, Any] = (
        {"rotation": 30, "ha": "left", "rotation_mode": "anchor"} if many else {}
    )
    axes.set_xticks(places - 0.2 * many, columns, **slanted)
    axes.xaxis.tick_top()
    names = [fill(f"{row.words} [{row.unit}²]", 16 if many else 22) for row in rows]
    axes.set_yticks(np.arange(len(rows)) + 0.5, names)
    axes.set_xlim(0, len(columns) - 1 + LAST)
    axes.set_ylim(len(rows), 0)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    handles = [Line2D([], [], linestyle="", label=REMAINS)]
    if any(cell.unsure for row in rows for cell in row.parts):
        handles.append(Line2D([], [], linestyle="", color=INK, label=UNSURE, **RING))
    figure.legend(handles=handles, loc="outside lower left", ncols=1, handlelength=1)
    return figure


def _draw(axes, y, row, shown):
    """A row: the clean variance, a cell for each cause, the whole, and both as deviations."""
    size = SMALL if len(shown) >= MANY else TEXT
    _cell(axes, 0, y, PLAIN, row.clean, size)
    total = sum(abs(part.value) for part in row.parts) or 1.0
    for x, part in enumerate(row.parts, start=1):
        colour = COLOURS(0.5 + 0.5 * PALEST * part.value / total)
        below = f"→ {directions.deviation(part.remaining)}"
        # Of many causes the cells are narrow: the number makes room for its ring.
        aside = 0.07 * (part.unsure and len(shown) >= MANY)
        _cell(axes, x, y, colour, part.value, size, below, aside)
        if part.unsure:
            axes.plot(x + 0.88, y + 0.73, color=readable(colour), **RING)
    _cell(axes, len(shown) + 1, y, PLAIN, row.value, size)
    before, after = directions.deviation(row.clean), directions.deviation(row.value)
    text = f"{before} → {after} {row.unit}"
    place = len(shown) + 2 + LAST / 2
    axes.text(place, y + 0.5, text, ha="center", va="center", fontsize=SMALL)


def _cell(axes, x, y, colour, value, size, below="", aside=0.0):
    """A number on its colour, and in small what stands below it, so far aside to the left."""
    corner = x + 0.03, y + 0.04
    axes.add_patch(Rectangle(corner, 0.94, 0.92, facecolor=colour, edgecolor="none"))
    text = words.significant(value).replace("-", "−")
    place = {"ha": "center", "va": "center", "color": readable(colour)}
    axes.text(x + 0.5, y + (0.33 if below else 0.5), text, fontsize=size, **place)
    if below:
        axes.text(x + 0.5 - aside, y + 0.73, below, fontsize=SMALL, **place)
