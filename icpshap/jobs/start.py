"""What lies in resources/ and results/ when a run begins, held against the plan.

The workflow itself sees dates and, as long as its own records last, parameters. This looks into
the files: one that another plan made is put aside, so that it is made again; one that no plan
makes is named.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from icpshap import storage, tables
from icpshap.errors import UserError
from icpshap.jobs import paths, plans
from icpshap.jobs.paths import at

if TYPE_CHECKING:
    from icpshap.jobs.plans import Plans


FOLDERS = ("logs", "resources", "results")
STALE = ".stale"
SHOWN = 3  # files that are named; of more their number is told
OF_EXPLANATION = (
    "pairs",
    "fit",
    "uncertainty",
    "shap",
    "directions",
    "covariances",
    "resampled",
)


# Options by which snakemake does something else than to make files.
NO_RUN = re.compile(
    r"-(?![cj])[a-zA-Z]*[nltSD]|--(dry-?run|lint|unlock|list|touch|dag|rulegraph|filegraph|d3dag|summary|"
    r"detailed-summary|report|archive|cleanup|delete|export|generate|print-compilation|bash|version|help)"
)


def is_run(arguments: Iterable[str]) -> bool:
    """Whether a command line of snakemake makes files, and does not only look at them."""
    return not any(NO_RUN.match(word) for word in arguments)


def check_folders() -> None:
    """Raise UserError if a folder of the workflow cannot be written to, before a job fails of it.

    A folder that is missing is made; the working directory can be written to, or Snakemake itself
    would not have come so far.
    """
    for folder in map(Path, FOLDERS):
        if folder.exists() and not folder.is_dir():
            raise UserError(
                f"{folder}: is a file; the workflow keeps a folder of this name.\n"
                "Hint: move it away."
            )
        if folder.exists() and not os.access(folder, os.W_OK | os.X_OK):
            raise UserError(
                f"{folder}: the folder cannot be written to.\n"
                "Hint: is its disk read-only, or does it belong to somebody else?"
            )


def look(
    planner: Plans, experiments: Sequence[str], sequences: Sequence[str], puts_aside: bool = True
) -> list[str]:
    """Put aside what another plan made, as <name>.stale, and say so: lines of text.

    planner: a plans.Plans; experiments, sequences: names of what is selected; puts_aside: False
    where this is only looked at.
    """
    stale: list[tuple[Path, str]] = []
    for path, table, plan in planned_files(planner, experiments, sequences):
        about = _about(path)
        if difference := _difference(about, table, plan, in_words=not stale):
            stale.append((path, difference))
    stale += newly_registered(planner, experiments, sequences, {path for path, _ in stale})
    if puts_aside:
        for path, _ in stale:
            os.replace(path, f"{path}{STALE}")
    lines = []
    if stale:
        path, difference = stale[0]
        lines.append(
            f"{len(stale)} file(s) were made by another plan. They are kept as *{STALE}, and made "
            f"again where they are needed; the first is {path} ({difference})."
        )
        if puts_aside:
            _put_aside_what_follows(planner, experiments, [path for path, _ in stale])
    if strangers := list(unplanned_files(planner, experiments, sequences)):
        named = ", ".join(map(str, strangers[:SHOWN]))
        lines.append(
            f"{len(strangers)} file(s) belong to no job of the plan and are not read: {named}"
            f"{', ...' if len(strangers) > SHOWN else ''}. "
            "They are left over from another configuration; remove them when you like."
        )
    return lines


def _put_aside_what_follows(planner, experiments, stale):
    """Put aside the tables of the sequences of stale files: what is whole asks for nothing.

    The workflow does not make a missing file whose followers are all there.
    """
    for name, sequence in _selected(planner, experiments, planner.config.data):
        if not any(sequence in Path(path).parts for path in stale):
            continue
        for table in OF_EXPLANATION:
            names = {"experiment": name, "table": table}
            for path in (
                at(paths.OF_SEQUENCE, sequence=sequence, **names),
                at(paths.OF_EXPERIMENT, **names),
            ):
                if os.path.exists(path):
                    os.replace(path, f"{path}{STALE}")


def planned_files(
    planner: Plans, experiments: Sequence[str], sequences: Sequence[str]
) -> Iterator[tuple[Path, str, dict[str, Any]]]:
    """(path, name of the table, plan) of every file that is there and has a plan."""
    for path, table, plan in _plans(planner, experiments, sequences):
        if os.path.exists(path):
            yield path, table, plan()


def unplanned_files(
    planner: Plans, experiments: Sequence[str], sequences: Sequence[str]
) -> Iterator[Path]:
    """Files of jobs, of runs, estimates and pairs, that are there and are not planned."""
    planned = {Path(path) for path, *_ in _plans(planner, experiments, sequences)}
    for experiment, sequence in _selected(planner, experiments, sequences):
        names = {"experiment": experiment, "sequence": sequence}
        of_batch = [at(paths.OF_BATCH, table=table) for table in planner.of_diagnosis]
        for template in (paths.RUNS, paths.ESTIMATES, paths.PAIRS, *of_batch):
            folder = Path(at(template, **names)).parent
            yield from (path for path in sorted(folder.glob("*.parquet")) if path not in planned)


def _about(path):
    """What a file was written with; None if it cannot be read."""
    try:
        return storage.read_about(path)
    except UserError:
        return None


def _difference(about, table, plan, in_words):
    """How a file differs from the one that should lie there; "" if it does not.

    in_words: whether it is told in which values plans differ, which takes longer.
    """
    if about is None:
        return "it cannot be read"
    if about.get("table") != table:
        return f"it is a table of {about.get('table')}"
    found = about.get("plan", {})
    if plans.digest(found) == plans.digest(plan):
        return ""
    return plans.difference(found, plan) if in_words else "another plan"


def newly_registered(
    planner: Plans, experiments: Sequence[str], sequences: Sequence[str], stale: Collection[Path]
) -> Iterator[tuple[Path, str]]:
    """(path, words) of files of runs or estimates without a pair that is registered by now.

    Checks of pairs are no reason to register again, so that the workflow would not see it. What is
    diagnosed is: its plan says how much overlap is demanded. Files that are `stale` anyway are left
    out.
    """
    smallest = planner.config.perturbation.minimum_overlap
    for name, sequence in _selected(planner, experiments, sequences):
        if planner.config.experiments[name].measured:
            continue
        names = {"experiment": name, "sequence": sequence}
        above: set[str] = set()
        for batch in range(len(planner.batches(name, sequence))):
            path = at(paths.OVERLAPS, **names, batch=batch)
            measured = (_about(path) if path not in stale else None) or {}
            parts = measured.get("parts", {}).items()
            above |= {pair for pair, told in parts if told.get("overlap", 0.0) > smallest}
        for path, table, plan in _estimates(planner, name, sequence):
            about = None if path in stale else _about(path)
            if not about or about.get("table") != table:
                continue
            found = {tables.pair_part(pair) for pair in about.get("registered", [])}
            parts = [tables.pair_part(pair) for pair, *_ in plan()["parts"]]
            if new := [pair for pair in parts if pair in above and pair not in found]:
                yield path, f"pair {new[0]} is registered now, and was not"


def _selected(planner, experiments, sequences):
    for name in experiments:
        for sequence in planner.config.experiments[name].pairs:
            if sequence in sequences:
                yield name, sequence


def _plans(planner, experiments, sequences):
    """(path, table, function that makes the plan) of every file that the selection may make."""
    for sequence in sequences:
        known = planner.config.data[sequence]
        yield at(paths.POSES, sequence=sequence), "poses", partial(planner.poses, sequence)
        if known.registers:
            for batch in range(len(planner.registration_batches(sequence))):
                path = at(paths.REGISTRATIONS, sequence=sequence, batch=batch)
                yield path, "registrations", partial(planner.registrations, sequence, batch)
        for batch in range(len(planner.scan_batches(sequence))):
            path = at(paths.SCANS, sequence=sequence, batch=batch)
            table = "timed_scans" if known.time else "scans"
            yield path, table, partial(planner.scans, sequence, batch)
    for name, sequence in _selected(planner, experiments, sequences):
        yield from _plans_of(planner, name, sequence)
    for name in experiments:
        for table in OF_EXPLANATION:
            path = at(paths.OF_EXPERIMENT, experiment=name, table=table)
            yield path, table, partial(planner.joined, name)


def _plans_of(planner, name, sequence):
    names = {"experiment": name, "sequence": sequence}
    checked = [(paths.PAIRS, "pairs"), (paths.OVERLAPS, "overlaps")]
    checked += [(paths.FIT_NUMBERS, "fit_numbers")]
    for batch in range(len(planner.batches(name, sequence))):
        for template, table in checked:
            path = at(template, **names, batch=batch)
            yield path, table, partial(planner.checks, name, sequence, batch)
    for table, (of_batch, of_all) in planner.of_diagnosis.items():
        if table == "instances" and not planner.config.experiments[name].measured:
            continue
        for batch in range(len(planner.diagnosis_batches(name, sequence))):
            path = at(paths.OF_BATCH, **names, table=table, batch=batch)
            yield path, table, partial(of_batch, name, sequence, batch)
        path = at(paths.OF_SEQUENCE, **names, table=table)
        yield path, table, partial(of_all, name, sequence)
    yield from _estimates(planner, name, sequence)
    if planner.estimator(name).returned.samples:
        learned_from = at(paths.DESCRIPTORS, **names)
        yield learned_from, "descriptors", partial(planner.descriptors, name, sequence)
    for table in OF_EXPLANATION:
        path = at(paths.OF_SEQUENCE, **names, table=table)
        yield path, table, partial(planner.explanation, name, sequence)


def _estimates(planner, name, sequence):
    """The same of the files of runs and estimates of a sequence."""
    returns = planner.estimator(name).returned
    made = [
        (paths.RUNS, "runs", returns.samples),
        (paths.ESTIMATES, "estimates", returns.covariances),
    ]
    names = {"experiment": name, "sequence": sequence}
    for job in range(len(planner.jobs(name, sequence))):
        for template, table in ((template, table) for template, table, is_made in made if is_made):
            yield at(template, **names, job=job), table, partial(planner.job, name, sequence, job)
