"""How all figures look, and how they are saved: same inputs, same bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import matplotlib
import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.ticker import FixedLocator, FuncFormatter

from icpshap.report import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from icpshap.causes.cause import Cause


# Width of every figure [inch]: that of a page of a two-column paper, and of the report.
PAGE = 7.16
# Sizes of type [pt]: at that width on the report's page as large as its text, and as its captions.
TEXT, SMALL = 9, 7.7
RASTER_DPI = 300

# Heights [inch] of a row of a plot, and of what is above and below all rows.
ROW, AROUND_ROWS = 0.5, 0.8

# Okabe and Ito's colours, which people with any colour vision can tell apart.
INCREASE, DECREASE, NARROWING = "#D55E00", "#0072B2", "#009E73"
INK, MUTED, FAINT = "#222222", "#777777", "#DDDDDD"
BAND = "#F5F5F5"  # behind every second row or lane
# Dark to bright without the palest part, which is lost on white paper.
LEVELS = ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, 0.9, 256)))

STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": TEXT,
    "axes.labelsize": TEXT,
    "axes.titlesize": TEXT,
    "xtick.labelsize": TEXT,
    "ytick.labelsize": TEXT,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "hatch.linewidth": 0.6,
    "figure.constrained_layout.use": True,
    "savefig.dpi": RASTER_DPI,
    "svg.hashsalt": "icpshap",
}


@contextmanager
def styled() -> Iterator[None]:
    """The style of all figures."""
    with matplotlib.rc_context(STYLE):
        yield


def save(figure: Figure, *paths: str | Path) -> None:
    """Save a figure under each path (.png or .svg), without date or version."""
    with styled():
        for path in paths:
            unset = {"Date": None, "Creator": None} if str(path).endswith("svg") else {}
            figure.savefig(path, metadata=unset or {"Software": None})


def settle(figure: Figure) -> None:
    """Lay out a figure for good, at rounded places.

    The solver behind a layout with panels of different heights goes by addresses in memory, so that
    last digits of places, and with them the bytes of an SVG, differ from one time to the next.
    """
    figure.draw_without_rendering()
    places = [np.round(axes.get_position().bounds, 6) for axes in figure.axes]
    figure.set_layout_engine("none")
    for axes, place in zip(figure.axes, places, strict=True):
        axes.set_position(place)


def value_label(cause: Cause | type[Cause], unit: str) -> str:
    """Axis label of a cause's Shapley value."""
    return f"φ {cause.title} [{unit}]"


def rows_height(rows: int) -> float:
    """Height [inch] of a figure with so many rows; each has the same height in any figure."""
    return AROUND_ROWS + ROW * rows


def say_nothing(figure: Figure, message: str) -> Figure:
    """Turn a figure that has nothing to show into one that says why."""
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.text(0.5, 0.5, message, ha="center", va="center", wrap=True, color=MUTED)
    return figure


def mark_noise_floor(span: Callable, null_95: float) -> None:
    """Mark, with an axis' `span` function, what f is by chance alone, if it is anything."""
    if np.isfinite(null_95) and null_95 > 0:
        label = "noise floor: f by chance alone (95 %)"
        span(0, null_95, color=FAINT, zorder=-2, linewidth=0, label=label)


def symmetric_logarithmic(axes: Axes, direction: Literal["x", "y"], linear: float = 1.0) -> None:
    """Make the x or y axis linear up to a value and logarithmic beyond, for small and huge ones."""
    {"x": axes.set_xscale, "y": axes.set_yscale}[direction]("symlog", linthresh=linear)
    axes.autoscale(axis=direction)
    largest = np.abs({"x": axes.get_xlim, "y": axes.get_ylim}[direction]()).max()
    step = 1 if largest < 1e4 * linear else 2
    powers = linear * 10.0 ** np.arange(0, 20, step)
    axis = {"x": axes.xaxis, "y": axes.yaxis}[direction]
    axis.set_major_locator(FixedLocator([*-powers[::-1], 0, *powers]))
    axis.set_major_formatter(FuncFormatter(power_of_ten))


def power_of_ten(value: float, _: object) -> str:
    """A tick of a logarithmic axis as text."""
    if abs(value) <= 100:
        return f"{value:g}".replace("-", "−")
    return f"${'-' * int(value < 0)}10^{{{np.log10(abs(value)):.0f}}}$"


def tame(axes: Axes, direction: Literal["x", "y"], values: np.ndarray) -> None:
    """Leave an axis linear unless values (...) are so large that the others would vanish."""
    if words.is_huge(values):
        symmetric_logarithmic(axes, direction)
