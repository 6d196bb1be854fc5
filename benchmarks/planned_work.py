"""The jobs of a plan and how long each works: what simulations of clusters are made of.

From the configuration alone, as the workflow plans them; seconds by what was measured of a run and
a pair. Figures, tables and the report, which run where the workflow was started, are left out.
"""

import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import yaml
from snakemake.utils import update_config

from icpshap import config
from icpshap.jobs import few, time_limits
from icpshap.jobs.plans import Plans

REPOSITORY = Path(__file__).parents[1]
# Points of a scan, and CPU seconds of a run of the estimator `paper` in the eight settings of a
# pair: docs/engine.md, registration jobs; which scene stands for which sequence: benchmarks/icp.py.
SCANS = {
    "apartment": (367_000, 23.5 / 800),
    "eth": (170_000, 11.5 / 800),
    "stairs": (170_000, 11.5 / 800),
    "mountain": (94_000, 4.3 / 800),
}
OF_OTHERS = (170_000, 7.6 / 800)
OF_DRIVE = (130_000, 5.6 / 800)  # a scanner on a car
OF_GRID = 82.7 / 4000  # a run where hundreds of settings share a reference: grid job at 0.05 m
MANY = 40  # settings of a pair in one job
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
    local = few.few(plans)
    found = []

    def of_sequence(rule):
        return few.RULES[rule] if f"{name}/{sequence}" in local[rule] else rule

    def add(rule, seconds, after=()):
        found.append(Task(rule, seconds, tuple(after)))
        return len(found) - 1

    for name in loaded.run:
        for sequence in loaded.experiments[name].pairs:
            points, of_run = OF_DRIVE if drive else SCANS.get(sequence, OF_OTHERS)
            millions = points / 1e6
            reads = [
                add("read_scans", OF_READING * millions * len(batch))
                for batch in (plans.scan_batches(sequence) if drive else ())
            ]
            checks = [
                add(
                    of_sequence("check_pairs"),
                    time_limits.OF_CHECK * millions * len(batch),
                    reads,
                )
                for batch in plans.batches(name, sequence)
            ]
            for places in plans.diagnosis_batches(name, sequence):
                among = plans.pairs_beside(name, sequence, places)
                seconds = time_limits.seconds_of_diagnosis(len(among), points)
                add(of_sequence("diagnose_pairs"), seconds, checks)
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
            interval = loaded.preset(name).method.interval
            work = sum(map(sum, jobs)), runs, interval
            seconds = time_limits.seconds_of_explanation(*work)
            add(of_sequence("explain_sequence"), seconds, registrations)
    return found


def _seconds(runs, settings, of_run):
    return runs * (min(OF_GRID, of_run) if settings >= MANY else of_run)


def local_rules():
    """Names of the rules whose jobs run where the workflow was started."""
    workflow = REPOSITORY / "workflow"
    found = set()
    for file in (workflow / "Snakefile", *workflow.glob("rules/*.smk")):
        rules = re.split(
            r"^ *(?:use )?rule (?:\w+ as )?(?=\w+)", file.read_text("utf-8"), flags=re.M
        )
        found |= {re.match(r"\w+", rule)[0] for rule in rules[1:] if "localrule: True" in rule}
    return found


def submitted(found):
    """The tasks without those of local rules, for which the others then do not wait."""
    local = local_rules()
    places = [place for place, task in enumerate(found) if task.rule not in local]
    numbers = {place: number for number, place in enumerate(places)}
    return [
        found[place]._replace(after=tuple(numbers[k] for k in found[place].after if k in numbers))
        for place in places
    ]


def short_jobs(jobs, found):
    """Of planned jobs, by rule, those of less than few.SECONDS, of local rules and of others.

    jobs: number by rule; found: the tasks among them. All others are of local rules, and short.
    """
    short = Counter(task.rule for task in found if task.seconds < few.SECONDS)
    known, local = {task.rule for task in found}, local_rules()
    short.update({rule: number for rule, number in jobs.items() if rule not in known})
    not_local = sum(number for rule, number in short.items() if rule not in local)
    return short.total() - not_local, not_local


def by_rule(found, seconds=few.SECONDS):
    """Rows of a table: jobs of each rule, how long they work, and how many less than `seconds`."""
    rows, local = [], local_rules()
    for rule in dict.fromkeys(task.rule for task in found):
        of_rule = [task.seconds for task in found if task.rule == rule]
        rows.append(
            {
                "rule": rule,
                "jobs": len(of_rule),
                "seconds, from": min(of_rule),
                "to": max(of_rule),
                f"under {seconds} s": sum(each < seconds for each in of_rule),
                "local": "yes" if rule in local else "no",
                "hours": sum(of_rule) / 3600,
            }
        )
    return rows
