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
from icpshap.jobs import paths
from icpshap.jobs.explained import explained
from icpshap.jobs.paths import at
from icpshap.jobs.plans import Plans, digest, is_settled
from icpshap.report import figures, in_doubt, page
from icpshap.report.figures.style import save, styled
from icpshap.report.study import Study

OF_PAGE = ("shap", "directions", "pairs", "fit")


def finished(planner: Plans, experiment: str, sequence: str) -> dict[str, Any]:
    """What is finished of a sequence: files of jobs and digests of their plans, and pairs.

    A mapping that JSON can hold. planner: a plans.Plans. A file counts if it was made by its plan,
    a pair if all of its jobs' files do.
    """
    names = {"experiment": experiment, "sequence": sequence}
    known = planner.config.experiments[experiment]
    returns = planner.estimator(experiment).returned
    estimated = {"runs": paths.RUNS} if returns.samples else {}
    estimated |= {"estimates": paths.ESTIMATES} if returns.covariances else {}
    jobs = planner.jobs(experiment, sequence)
    plans = [planner.job(experiment, sequence, job) for job in range(len(jobs))]
    done = [
        job
        for job, plan in enumerate(plans)
        if all(is_settled(at(file, **names, job=job), plan) for file in estimated.values())
    ]
    batches = planner.batches(experiment, sequence)
    checks = [planner.checks(experiment, sequence, batch) for batch in range(len(batches))]
    checked = {"pairs": paths.PAIRS, "fit": paths.FIT_NUMBERS}
    sound = [
        batch
        for batch, plan in enumerate(checks)
        if all(is_settled(at(file, **names, batch=batch), plan) for file in checked.values())
    ]
    missing = {part.pair for job in set(range(len(jobs))) - set(done) for part in jobs[job]}
    ready = {pair for batch in sound for pair in batches[batch]} - missing
    return {
        **names,
        "pairs": sorted(list(pair) for pair in ready),
        "of": len(known.pairs[sequence]),
        "files": {
            "runs": [],
            "estimates": [],
            "instances": [at(paths.INSTANCES, **names)] if known.measured else [],
            "diagnosis": [at(paths.DIAGNOSIS, **names)] if known.measured else [],
            **{of: [at(file, **names, job=job) for job in done] for of, file in estimated.items()},
            **{of: [at(file, **names, batch=k) for k in sound] for of, file in checked.items()},
        },
        "jobs": [digest(plans[job]) for job in done],
        "checks": [digest(checks[batch]) for batch in sound],
        "planned": planner.explanation(experiment, sequence),
        "figures": list(known.figures),
    }


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
