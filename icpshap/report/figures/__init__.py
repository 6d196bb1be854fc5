"""Figures: tables in, matplotlib figures out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from icpshap.report import captions
from icpshap.report.figures import couples, directions, drive, pairs, shapley, style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from icpshap.report.study import Study


DRAWERS = {
    "summary": shapley.summary,
    "waterfall": shapley.waterfall,
    "interactions": couples.interactions,
    "pairs": pairs.pairs,
    "drive": drive.drive,
}
# Those of the study's instance alone, of each pair that there is.
ONE_INSTANCE = ("waterfall", "drive")


def draw(
    name: str, table: pd.DataFrame, directions_table: pd.DataFrame, study: Study
) -> tuple[Figure, str]:
    """The named figure of a shap and a directions table, and its caption; study: `study.Study`.

    Dependence figures are those of the study's couples. Raises KeyError for another name.
    """
    if name == "directions":
        with style.styled():
            figure = directions.picture(directions_table, study)
        return figure, captions.of_directions(directions_table, table, study)
    if name in ONE_INSTANCE:
        table = study.instance(table, study.waterfall)
    with style.styled():
        if name in study.dependence_figures:
            figure = shapley.dependence(table, study, *study.dependence_figures[name])
        else:
            figure = DRAWERS[name](table, study)
    return figure, captions.caption(name, table, study)
