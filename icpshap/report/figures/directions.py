"""Which cause makes which direction uncertain: directions by causes."""

from textwrap import fill

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from icpshap.report import captions, directions, words
from icpshap.report.figures.couples import PLAIN, RING, readable
from icpshap.report.figures.style import AROUND_ROWS, INK, PAGE, say_nothing

COLOURS = matplotlib.colormaps["RdBu_r"]
PALEST = 0.85  # of the colour scale's range, so that numbers stay readable
ROW = 0.34  # inch
MANY = 5  # causes, from which their titles have less room


def picture(table, study):
    """Variances of the directions, and what each cause adds; a directions table of one scope.

    Of several instances the medians. A cell is coloured by its part of all parts of its row; below
    the part stands the standard deviation that remains without the cause.
    """
    shown, rows = study.shown(table), directions.summary(table, study)
    figure = plt.figure(figsize=(PAGE, AROUND_ROWS + 0.2 + ROW * max(1, len(rows))))
    if not shown:
        return say_nothing(figure, captions.NOTHING_PERTURBED)
    if not rows:
        return say_nothing(figure, "No instance has a value.")
    axes = figure.add_subplot()
    for y, row in enumerate(rows):
        _draw(axes, y, row, shown)
    columns = [
        "clean",
        *(fill(cause.title, 14 if len(shown) < MANY else 11) for cause in shown),
        "in all",
        "standard\ndeviation",
    ]
    axes.set_xticks(np.append(np.arange(len(columns) - 1) + 0.5, len(columns) - 0.4), columns)
    axes.xaxis.tick_top()
    if len(shown) >= MANY:
        axes.tick_params(axis="x", labelsize=5.5)
    axes.set_yticks(np.arange(len(rows)) + 0.5, [f"{fill(r.words, 26)} [{r.unit}²]" for r in rows])
    axes.set_xlim(0, len(columns) + 0.2)
    axes.set_ylim(len(rows), 0)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    if any(cell.unsure for row in rows for cell in row.parts):
        ring = "most 95 % intervals contain 0: cannot be told from zero"
        handle = Line2D([], [], linestyle="", color=INK, label=ring, **RING)
        figure.legend(handles=[handle], loc="outside lower left")
    return figure


def _draw(axes, y, row, shown):
    """A row: the clean variance, a cell for each cause, the whole, and both as deviations."""
    _cell(axes, 0, y, PLAIN, row.clean)
    total = sum(abs(part.value) for part in row.parts) or 1.0
    for x, part in enumerate(row.parts, start=1):
        colour = COLOURS(0.5 + 0.5 * PALEST * part.value / total)
        remains = f"{directions.deviation(part.remaining)} {row.unit} without"
        _cell(axes, x, y, colour, part.value, remains)
        if part.unsure:
            axes.plot(x + 0.92, y + 0.22, color=readable(colour), **RING)
    _cell(axes, len(shown) + 1, y, PLAIN, row.value)
    before, after = directions.deviation(row.clean), directions.deviation(row.value)
    text = f"{before} → {after} {row.unit}"
    axes.text(len(shown) + 2.6, y + 0.5, text, ha="center", va="center", fontsize=6)


def _cell(axes, x, y, colour, value, below=""):
    """A number on its colour, and in small what stands below it."""
    corner = x + 0.03, y + 0.04
    axes.add_patch(Rectangle(corner, 0.94, 0.92, facecolor=colour, edgecolor="none"))
    text = words.significant(value).replace("-", "−")
    place = {"ha": "center", "va": "center", "color": readable(colour)}
    axes.text(x + 0.5, y + (0.34 if below else 0.5), text, fontsize=6, **place)
    if below:
        axes.text(x + 0.5, y + 0.72, below, fontsize=4.5, **place)
