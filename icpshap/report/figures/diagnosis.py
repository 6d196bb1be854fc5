"""Which causes stand out in which pairs of a sequence: a cell for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import TwoSlopeNorm

from icpshap import causes
from icpshap.diagnosis.verdict import FOUND, UNDECIDED, UNKNOWN
from icpshap.report import words
from icpshap.report.figures.style import INK, PAGE, SMALL, rows_height, say_nothing

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


FAR = 6.0  # standard deviations, from which on a cell is darkest
MANY = 40  # pairs, from which on cells have no text
ROW = 0.3  # inch, of a pair


def picture(table: pd.DataFrame, titles: Mapping[str, str]) -> Figure:
    """The figure of a table `diagnosis`; titles: of its sequences, by key."""
    known = table[table.verdict != UNKNOWN]
    names = causes.shown()
    if known.empty:
        figure = plt.figure(figsize=(PAGE, rows_height(1)))
        return say_nothing(figure, "No pair can be held against another one.")
    few = len(known) <= MANY
    figure = plt.figure(figsize=(PAGE, 1.1 + ROW * min(len(known), MANY)))
    axes = figure.add_subplot()
    z = known[[f"z_{name}" for name in names]].to_numpy()
    norm = TwoSlopeNorm(0.0, -FAR, FAR)
    image = axes.imshow(np.clip(z, -FAR, FAR), cmap="RdBu_r", norm=norm, aspect="auto")
    axes.set_xticks(range(len(names)), [causes.CAUSES[name].title for name in names])
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    if few:
        labels = [
            f"{titles.get(row.sequence, row.sequence)} {row.reference}–{row.source}"
            for row in known.itertuples()
        ]
        axes.set_yticks(range(len(known)), labels)
    else:
        axes.set_ylabel("pair, in the order of the sequence")
    for place, row in enumerate(known.itertuples()):
        for column, name in enumerate(names):
            _mark(axes, place, column, row, name, few)
    bar = figure.colorbar(image, ax=axes, shrink=min(1.0, 3 / len(known) + 0.3), extend="both")
    bar.set_label("standard deviations\nfrom the other pairs")
    return figure


def _mark(axes, place, column, row, name, with_text):
    """The level in the cell of a cause that is found; a question mark where two cannot be told."""
    if name not in row.causes.split(", ") or row.verdict not in (FOUND, UNDECIDED):
        return
    cause = causes.CAUSES[name]()
    text = "?"
    if row.verdict == FOUND:
        level = words.significant(getattr(row, f"level_{name}"))
        text = f"{cause.symbol} = {level} {cause.unit}".strip()
    dark = abs(getattr(row, f"z_{name}")) > FAR / 2
    if with_text:
        colour = "white" if dark else INK
        axes.text(column, place, text, ha="center", va="center", fontsize=SMALL, color=colour)


def caption(table: pd.DataFrame) -> str:
    """What the figure shows."""
    known = int((table.verdict != UNKNOWN).sum())
    unknown = len(table) - known
    left_out = f"; {unknown} more could not be held against another one" if unknown else ""
    return (
        "What is wrong with each pair, measured without ICP: how many standard deviations of the "
        "other pairs its plane residual (sensor noise), overlap (partial overlap) and weakest "
        "information share (under-constrained situation) are away, red where the cause would move "
        "them. Cells of causes that are found say the level, '?' that two cannot be told apart. "
        f"{known} pair{'s' * (known != 1)}{left_out}. What all pairs have is not seen, nor are "
        "causes that leave no mark in the scans."
    )
