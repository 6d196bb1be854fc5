"""The jobs of a plan and how long each works: what simulations of clusters are made of.

From the configuration alone, as the workflow plans them; seconds by what was measured of a run and
a pair. Figures, tables and the report, which run where the workflow was started, are left out.
"""

from pathlib import Path
from typing import NamedTuple

import yaml
from snakemake.utils import update_config

from icpshap import config
from icpshap.jobs.plans import Plans

REPOSITORY = Path(__file__).parents[1]
# Points of a scan, and CPU seconds of a run of the estimator `paper` in the eight settings of a
# pair: docs/engine.md, registration jobs; which scene stands for which sequence: benchmarks/icp.py.
SCANS = {
    "apartment": (367_000, 41.9 / 800),
    "eth": (170_000, 20.8 / 800),
    "stairs": (170_000, 20.8 / 800),
    "mountain": (94_000, 7.7 / 800),
}
OF_OTHERS = (170_000, 13.5 / 800)
OF_DRIVE = (130_000, 10.5 / 800)  # a scanner on a car
OF_GRID = 156 / 4000  # a run where hundreds of settings share a reference: grid job at 0.05 m
MANY = 40  # settings of a pair in one job
# Seconds of a pair of scans of a million points, and of a setting that is explained.
OF_CHECK, OF_DIAGNOSIS, OF_EXPLANATION = 15.0, 30.0, 0.02
OF_READING = 0.5  # of a scan of a million points


class Task(NamedTuple):
    """A job: its rule, how long it works [s], and the indices of the tasks that it waits for."""

    rule: str
    seconds: float
    after: tuple[int, ...]


def over_paper(configuration):
    """A configuration laid over the paper's, as snakemake does it."""
    found = yaml.safe_load((REPOSITORY / "config.yaml").read_text(encoding="utf-8"))
    update_config(found, configuration)
    return found


def paper(**keys):
    """The tasks of the paper's configuration with other keys; its scans are there."""
    return tasks(over_paper(keys))


def tasks(configuration, drive=False):
    """The tasks of a configuration; drive: whether scans are a car's, and have to be read first."""
    loaded = config.load(configuration)
    plans = Plans(loaded, {}, lambda *_: "")
    found = []

    def add(rule, seconds, after=()):
        found.append(Task(rule, seconds, tuple(after)))
        return len(found) - 1

    for name in loaded.run:
        for sequence, pairs in loaded.experiments[name].pairs.items():
            points, of_run = OF_DRIVE if drive else SCANS.get(sequence, OF_OTHERS)
            millions = points / 1e6
            reads = [
                add("read_scans", OF_READING * millions * len(batch))
                for batch in (plans.scan_batches(sequence) if drive else ())
            ]
            checks = [
                add("check_pairs", OF_CHECK * millions * len(batch), reads)
                for batch in plans.batches(name, sequence)
            ]
            add("diagnose_sequence", OF_DIAGNOSIS * millions * len(pairs), checks)
            runs = plans.estimator(name).number_of_runs
            jobs = [[part.stop - part.start for part in job] for job in plans.jobs(name, sequence)]
            registrations = [
                add(
                    "run_icp",
                    sum(_seconds(number * runs, number, of_run) for number in job),
                    checks,
                )
                for job in jobs
            ]
            settings = sum(map(sum, jobs))
            add("explain_sequence", OF_EXPLANATION * settings, registrations)
    return found


def _seconds(runs, settings, of_run):
    return runs * (min(OF_GRID, of_run) if settings >= MANY else of_run)


def by_rule(found, seconds=20):
    """Rows of a table: jobs of each rule, how long they work, and how many less than `seconds`."""
    rows = []
    for rule in dict.fromkeys(task.rule for task in found):
        of_rule = [task.seconds for task in found if task.rule == rule]
        rows.append(
            {
                "rule": rule,
                "jobs": len(of_rule),
                "seconds, from": min(of_rule),
                "to": max(of_rule),
                f"under {seconds} s": sum(each < seconds for each in of_rule),
                "hours": sum(of_rule) / 3600,
            }
        )
    return rows
