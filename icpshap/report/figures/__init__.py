"""Figures: tables in, matplotlib figures out."""

from icpshap.report import captions
from icpshap.report.figures import pairs, shapley, style

DRAWERS = {
    "summary": shapley.summary,
    "waterfall": shapley.waterfall,
    "interactions": pairs.interactions,
    "pairs": pairs.pairs,
}


def draw(name, table, study):
    """The named figure of a shap table, and its caption."""
    if name == "waterfall":
        table = captions.instance(table, study.waterfall)
    with style.styled():
        if name.startswith("dependence_"):
            figure = shapley.dependence(table, study, *captions.dependence_sources(name))
        else:
            figure = DRAWERS[name](table, study)
    return figure, captions.caption(name, table, study)
