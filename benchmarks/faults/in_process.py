"""The workflow's scripts without Snakemake: their functions on the files of a workplace.

Hundreds of faults are cheap this way. The plans are those that the Snakefile makes.
"""

import copy
import importlib.util
import os
from contextlib import contextmanager
from types import SimpleNamespace

import yaml
from snakemake.utils import update_config

from benchmarks.faults.workplace import REPOSITORY
from icpshap import config as configuration
from icpshap.data.folder import find_files
from icpshap.jobs import digests, paths, start
from icpshap.jobs.paths import at
from icpshap.jobs.plans import Plans

PAPER = yaml.safe_load((REPOSITORY / "config.yaml").read_text(encoding="utf-8"))
TABLES = start.OF_EXPLANATION


def script(name):
    """The module of a script of the workflow."""
    path = REPOSITORY / "workflow" / "scripts" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def merged(config):
    """A configuration laid over the paper's, as Snakemake does it."""
    whole = copy.deepcopy(PAPER)
    update_config(whole, copy.deepcopy(config))
    return whole


def planner(config, whole=None):
    """The plans of a configuration mapping that is laid over the paper's."""
    loaded = configuration.load(whole or merged(config))
    files = {
        key: find_files(sequence.folder, sequence.scans)
        for key, sequence in loaded.data.items()
        if sequence.kind == "folder" and key in loaded.sequences
    }
    scripts = REPOSITORY / "workflow" / "scripts"
    return Plans(loaded, files, lambda name, *p: digests.code_digest(scripts / f"{name}.py", p))


@contextmanager
def inside(folder):
    """Paths of the workflow are relative to its working directory."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def files_of(found, experiment, sequence):
    """The files that the explanation of a sequence reads, by their table."""
    names = {"experiment": experiment, "sequence": sequence}
    batches = range(len(found.batches(experiment, sequence)))
    pairs, fit = (
        [at(template, **names, batch=batch) for batch in batches]
        for template in (paths.PAIRS, paths.FIT_NUMBERS)
    )
    jobs = range(len(found.jobs(experiment, sequence)))
    runs = [at(paths.RUNS, **names, job=job) for job in jobs]
    # Called by name and by key, as the lists of files of a Snakemake job are.
    return Files(pairs=pairs, fit=fit, runs=runs, estimates=[], instances=[])


class Files(SimpleNamespace):
    def __getitem__(self, key):
        return getattr(self, key)

    def values(self):
        return vars(self)


def explain(found, experiment, sequence, output):
    """What explain_sequence does; output: the folder that its tables go to."""
    plan = found.explanation(experiment, sequence)
    files = files_of(found, experiment, sequence)
    tables = {name: f"{output}/{name}.parquet" for name in TABLES}
    digests = found.job_digests(experiment, sequence), found.check_digests(experiment, sequence)
    script("explain_sequence").explain_sequence(files, tables, plan, *digests)


def register(found, experiment, sequence, job, output):
    """What run_icp does of one job; output: the file of its runs."""
    plan = found.job(experiment, sequence, job)
    names = {"experiment": experiment, "sequence": sequence}
    checked = range(len(found.batches(experiment, sequence)))
    read = SimpleNamespace(
        scans=[
            at(paths.SCANS, sequence=sequence, batch=batch)
            for batch in range(len(found.scan_batches(sequence)))
        ],
        poses=at(paths.POSES, sequence=sequence),
        overlaps=[at(paths.OVERLAPS, **names, batch=batch) for batch in checked],
        pairs=[at(paths.PAIRS, **names, batch=batch) for batch in checked],
        training=[],
    )
    script("run_icp").run_icp(read, {"runs": output}, plan)
