"""Figures and the report page of one pair; needs the extra `plots`."""

from __future__ import annotations

import platform
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TYPE_CHECKING

from icpshap import options
from icpshap.errors import UserError, extra
from icpshap.explanation.method import Method

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from icpshap.one_pair.explanation import Explanation


SCENE = "scene"
FIGURES = ("waterfall", "interactions", "directions", SCENE)


def draw(explanation: Explanation, name: str) -> tuple[Figure, str]:
    """A figure of matplotlib by its name, and its caption.

    Raises UserError for another name, and for the scene of an explanation without scans.
    """
    if name not in FIGURES:
        raise UserError(
            f"figure {name!r}, expected one of {', '.join(FIGURES)}.\nHint: plot('waterfall')."
        )
    with extra("plots", "matplotlib", "shap"):
        from matplotlib import pyplot

        from icpshap.report import figures
    tables = explanation.tables
    if name == SCENE:
        figure, caption = _scene(explanation)
    else:
        shown = tables["shap"], tables["directions"], explanation.study
        figure, caption = figures.draw(name, *shown)
    pyplot.close(figure)  # a notebook would show it twice
    return figure, caption


def _scene(explanation):
    if explanation.scans is None:
        raise UserError(
            "This explanation was loaded, and scans are not saved with it.\n"
            "Hint: explain the pair again to see its scene."
        )
    from icpshap.report.figures import scene

    row = next(explanation.tables["pairs"].itertuples())
    known = explanation.options
    method = Method(**{name: known[name] for name in options.names(Method)})
    pair, kept_reference, kept_source = explanation.scans
    shown = scene.make_scene(
        pair,
        kept_reference,
        kept_source,
        explanation.tables.get("runs"),
        explanation.levels,
        method,
        row.characteristic_length,
    )
    return scene.picture(shown), scene.caption(shown, explanation.study, row)


def modules_of_the_page() -> tuple[ModuleType, Callable]:
    """report.page and style.save. Raises UserError without the extra."""
    with extra("plots", "matplotlib", "shap", "jinja2", "markupsafe"):
        from icpshap.report import page
        from icpshap.report.figures.style import save
    return page, save


def page(explanation: Explanation) -> str:
    """The report of one pair as HTML, with its pictures inside."""
    report, save = modules_of_the_page()
    names = [name for name in FIGURES if name != SCENE or explanation.scans is not None]
    with TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{name}.svg" for name in names]
        for name, path in zip(names, paths, strict=True):
            figure, caption = draw(explanation, name)
            save(figure, path)
            path.with_suffix(".txt").write_text(caption, encoding="utf-8")
        tables = explanation.tables
        section = report.Section(
            "pair",
            explanation.study,
            tables["shap"],
            tables["directions"],
            tables["pairs"],
            tables["fit"],
            tables.get("what_if"),
            None,
            paths,
            [],
        )
        return report.page([section], _run(explanation), folder)


def _run(explanation):
    """What the page says of how it was made."""
    from icpshap import __version__
    from icpshap.jobs import provenance

    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": __version__,
        "python": platform.python_version(),
        "packages": provenance.packages(),
        "host": provenance.host(),
        "config": {
            "seed": explanation.seed,
            "causes": explanation.levels,
            "estimator": explanation.options,
        },
    }
