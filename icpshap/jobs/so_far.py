"""What a run has found so far: a report of the pairs that are finished, while the others run.

It reads the files of finished jobs and writes into a folder of its own, so that nothing that the
run makes is overwritten, or taken for whole before it is.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib.pyplot as plt

from icpshap import selection, tables
from icpshap.jobs.explained import explained
from icpshap.report import figures, in_doubt, page
from icpshap.report.figures.style import save, styled
from icpshap.report.study import Study

OF_PAGE = ("shap", "directions", "pairs", "fit")


def words(found: Mapping[str, Any]) -> str:
    """How much of a sequence is finished."""
    finished_, scope = len(found["pairs"]), f"{found['experiment']}/{found['sequence']}"
    return f"{scope}: {finished_} of {found['of']} pairs"


def section(
    found: Mapping[str, Any], study: Study, figure_names: Sequence[str], folder: str | Path
) -> page.Section:
    """Tables and figures of the finished pairs, written into a folder: a `page.Section`.

    found: what `finished` returned, with some pairs; study: a `Study`; figure_names: those of the
    experiment, but for that along the drive.
    """
    pairs = {tuple(pair) for pair in found["pairs"]}
    planned = found["planned"]
    given = (SimpleNamespace(**found["files"]), planned, found["jobs"], found["checks"])
    made = explained(*given, only=pairs)
    folder = Path(folder, found["experiment"], found["sequence"])
    (folder / "figures").mkdir(parents=True)
    # Not the plan of the whole, so that no reader takes the one for the other.
    plan = {**planned, "so_far": found["pairs"]}
    files = {table: folder / f"{table}.parquet" for table in made}
    for table, frame in made.items():
        tables.write(files[table], frame, table, plan, list(planned["off"]))
    read = {table: tables.read(files[table], table) for table in OF_PAGE}
    if "drive" in found["figures"] and len(pairs) >= selection.FEWEST_OF_A_DRIVE:
        figure_names = ["drive", *figure_names]
        shown = study.instance(read["shap"], study.waterfall)
        in_doubt.ranking(shown, study).to_csv(folder / "figures" / "drive.csv", index=False)
    title = f"{'Partial' if len(pairs) < found['of'] else 'So far'}: {words(found)}."
    pictures = [_picture(name, read, study, folder / "figures", title) for name in figure_names]
    return page.Section(
        scope=f"{found['experiment']}/{found['sequence']}",
        study=study,
        **read,
        what_if=None,
        ranking=None,
        figures=pictures,
        links=list(files.values()),
        diagnosis=_diagnosis(found["files"]["diagnosis"]),
    )


def _diagnosis(files):
    """That of all pairs, which instances that are diagnosed are told by; None of others."""
    return tables.read_all(files, "diagnosis") if files else None


def _picture(name, read, study, folder, title):
    """Path of the SVG of a figure with a title that says what it is of, as does its caption."""
    figure, caption = figures.draw(name, read["shap"], read["directions"], study)
    with styled():
        for axes in figure.axes:  # one that was settled makes room for the title too
            axes.set_in_layout(True)
        figure.set_layout_engine("constrained")
        figure.suptitle(title, x=0.99, ha="right", fontsize="medium", fontweight="bold")
    svg = folder / f"{name}.svg"
    save(figure, svg.with_suffix(".png"), svg)
    plt.close(figure)
    svg.with_suffix(".txt").write_text(f"{title} {caption}\n", encoding="utf-8")
    return svg


def report(
    found: Sequence[Mapping[str, Any]],
    studies: Mapping[str, Mapping[str, Any]],
    figure_names: Mapping[str, Sequence[str]],
    run: Mapping[str, Any],
    folder: str | Path,
) -> list[str]:
    """Make the page of all that is finished in a new folder; returns how much that is, in lines.

    found: of each sequence what `finished` returned; studies, figure_names: by experiment, mappings
    that a `Study` is made of and names of figures; run: what `provenance.provenance` returned.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    sections = [
        section(
            part,
            Study(**studies[part["experiment"]]),
            figure_names[part["experiment"]],
            folder,
        )
        for part in found
        if part["pairs"]
    ]
    partial = [words(part) for part in found]
    text = page.page(sections, run, folder, partial=partial)
    (folder / "report.html").write_text(text, encoding="utf-8")
    return partial
