"""How far does the workflow scale: jobs, planning, and what a pair costs?

    python -m benchmarks.scale [plan] [cost] [--quick]

plan: dry runs of the paper's configuration and of simulated sequences up to 100,000 pairs, each in
a process of its own and an empty folder: jobs, CPU seconds, peak memory; how long the jobs of the
paper work, and the share of what they cost before they compute anything. cost: CPU seconds of a
pair's registrations against points, causes, runs and kinds of estimators, one of them changed at a
time from 100,000 points, three causes and 100 runs of the paper's; simulated scans, one core.

Prints tables, writes docs/figures/scale.svg where planning is asked for, and ends with a line of
JSON. Takes 10 minutes of CPU time; `--quick` makes everything small.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import yaml
from tabulate import tabulate

from benchmarks import planned_work
from benchmarks.icp import REPOSITORY, Clock, simulated_pair
from icpshap import causes, estimators, plan
from icpshap.data.pair import Pair
from icpshap.estimators.perturb import Perturbation, Streams

KITTI = 4541  # scans of its longest sequence
SCANS = (1001, KITTI, 20_001, 100_001)
POINTS = (20_000, 100_000, 367_000)
RUNS = (50, 100, 200)
INSTANCE = {  # in the order in which the causes join
    "sensor_noise": 0.05,
    "initial_pose": 1.5,
    "partial_overlap": 0.05,
    "icp_randomness": 2.0,
    "range_bias": 0.02,
}
NUMBERS = (1, 2, 3, 4, 5)  # of causes
KINDS = ("monte_carlo", "closed_form", "unscented", "gicp")
FETCHING = ("fetch_scan", "fetch_poses")
# What starts with every job: snakemake's preamble, and what a registration imports.
STARTING = (
    "import numpy, pandas, icpshap.estimators, icpshap.data.pair, icpshap.jobs.job, icpshap.tables"
)
MEASURE = (
    "import resource, subprocess, sys; code = subprocess.call(sys.argv[1:]); "
    "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
    "print('used', used.ru_utime + used.ru_stime, used.ru_maxrss / 1024); sys.exit(code)"
)


def configuration(scans):
    """A simulated sequence of so many scans, explained at one instance."""
    return {
        "sequences": ["drive"],
        "run": ["drive"],
        "data": {"drive": {"scans": scans, "simulated": {"scene": "street", "beams": 20_000}}},
        "experiments": {
            "drive": {
                "estimator": "paper",
                "pairs": "consecutive",
                "sequences": ["drive"],
                "instances": {"fixed": dict(list(INSTANCE.items())[:3])},
                "figures": ["summary", "interactions", "directions", "pairs"],
            }
        },
    }


def planned(config=None):
    """A dry run of a configuration laid over the paper's: jobs by rule, CPU seconds, MB."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "snakemake", "-n", "-q", "rules"]
        command += ["--snakefile", str(REPOSITORY / "Snakefile")]
        if config:
            Path(folder, "config.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
            command += ["--configfile", "config.yaml"]
        done = subprocess.run(
            [sys.executable, "-c", MEASURE, *command],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=True,
        )
    stats = done.stdout.partition("Job stats:")[2].partition("\n\n")[0]
    jobs = {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", stats, re.M)}
    seconds, peak = map(float, re.search(r"^used (\S+) (\S+)$", done.stdout, re.M).groups())
    jobs.pop("total")
    return jobs, seconds, peak


@cache
def planned_paper():
    """That of the paper's configuration as it is."""
    return planned()


def after_fetching(jobs):
    return sum(count for rule, count in jobs.items() if rule not in FETCHING)


def plans(quick):
    """A row for each configuration, and the jobs of the paper's by rule."""
    rows = []
    for scans in (None, *SCANS[: 2 if quick else None]):
        jobs, seconds, peak = planned(configuration(scans)) if scans else planned_paper()
        name = f"{scans:,} scans" if scans else "the paper, once fetched"
        row = {"plan": name, "pairs": scans - 1 if scans else 267, "jobs": after_fetching(jobs)}
        rows.append({**row, "run_icp": jobs["run_icp"], "seconds": seconds, "MB": peak})
        print(rows[-1], flush=True)
    return rows


def short_jobs_of_paper():
    """Jobs of the paper, once fetched, under 20 s: of local rules, and of others."""
    jobs, *_ = planned_paper()
    jobs = {rule: count for rule, count in jobs.items() if rule not in FETCHING}
    return planned_work.short_jobs(jobs, planned_work.paper())


@cache
def measured_pair(points):
    reference, source, T = simulated_pair("apartment", points)
    return Pair.measured(reference, source, T, 0.2)


def cost(points=367_000, number=3, runs=100, kind="monte_carlo"):
    """CPU seconds of the registrations of a pair, and its settings.

    number: of causes, in the order of INSTANCE.
    """
    levels = {name: [value] for name, value in list(INSTANCE.items())[:number]}
    settings = plan.settings(levels, 1)
    options = {"runs": runs} if kind == "monte_carlo" else {}
    pair = measured_pair(points)
    estimator = estimators.Estimator.of(kind, options).of_causes(causes.named(levels))
    streams = Streams(1, "scale", 0, 1)
    with Clock() as clock:
        estimators.estimate(pair, settings, estimator, Perturbation().deviation, streams)
    return clock.seconds, len(settings)


def costs(quick):
    """A row for each pair of what is changed and its value."""
    base = {"points": 4_000 if quick else POINTS[1], "runs": 20 if quick else 100}
    cost(**{**base, "points": 4_000})  # compiles, if need be
    axes = {
        "points": (2_000, 4_000) if quick else POINTS,
        "number": NUMBERS[:2] if quick else NUMBERS,
        "runs": (10, 20) if quick else RUNS,
        "kind": KINDS[:2] if quick else KINDS,
    }
    rows = []
    for axis, values in axes.items():
        for value in values:
            seconds, settings = cost(**{**base, axis: value})
            rows.append({"axis": axis, "value": value, "settings": settings, "seconds": seconds})
            print(rows[-1], flush=True)
    return rows


def start_of_a_job():
    """CPU seconds of a process that imports what a registration does."""
    command = [sys.executable, "-c", STARTING]
    before = os.times()
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": str(REPOSITORY)})
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])


def overhead_share(jobs):
    """Share of the paper's CPU time that so many jobs cost before they compute."""
    start = jobs * start_of_a_job()
    work = sum(task.seconds for task in planned_work.paper())
    return start / (start + work)


def draw(planned_rows, cost_rows, path):
    """Planning by pairs, and what was measured of a pair by what changes it, a panel each."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "icpshap"
    from matplotlib import pyplot

    words = {"points": "points of a scan", "number": "causes", "runs": "runs of a setting"}
    shown = [name for name in words if any(row["axis"] == name for row in cost_rows)]
    number = 1 + len(shown)
    figure, axes = pyplot.subplots(
        1, number, figsize=(3 * number + 1, 2.8), squeeze=False, layout="constrained"
    )
    drives = planned_rows[1:]
    pairs = [row["pairs"] for row in drives]
    for name, style in (("seconds", "o-"), ("MB", "s--"), ("jobs", "^:")):
        axes[0, 0].loglog(pairs, [row[name] for row in drives], style, label=name)
    axes[0, 0].set(xlabel="pairs", title="planning")
    axes[0, 0].legend(fontsize="small")
    for axis, name in zip(axes[0, 1:], shown, strict=True):
        rows = [row for row in cost_rows if row["axis"] == name]
        axis.plot([row["value"] for row in rows], [row["seconds"] for row in rows], "o-")
        axis.set(xlabel=words[name], ylabel="CPU s a pair", ylim=(0, None))
    figure.savefig(path, metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help="plan, cost; both if none is named")
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    parts = options.parts or ["plan", "cost"]
    found, cost_rows = {}, []
    if "plan" in parts:
        planned_rows = plans(options.quick)
        print(tabulate(planned_rows, headers="keys", tablefmt="github", floatfmt=".1f"))
        by_rule = planned_work.by_rule(planned_work.paper())
        print(tabulate(by_rule, headers="keys", tablefmt="github", floatfmt=".1f"))
        paper, kitti = planned_rows[0], planned_rows[2]
        found |= {"paper_jobs": paper["jobs"], "kitti_jobs": kitti["jobs"]}
        found |= {"kitti_plan_seconds": kitti["seconds"], "kitti_plan_mb": kitti["MB"]}
        local, not_local = short_jobs_of_paper()
        found |= {"paper_short_jobs": local + not_local, "paper_short_jobs_not_local": not_local}
        found["overhead_share"] = overhead_share(paper["jobs"])
    if "cost" in parts:
        cost_rows = costs(options.quick)
        print(tabulate(cost_rows, headers="keys", tablefmt="github", floatfmt=".2f"))
    if "plan" in parts and not options.quick:
        draw(planned_rows, cost_rows, REPOSITORY / "docs" / "figures" / "scale.svg")
    print(json.dumps({key: round(value, 4) for key, value in found.items()}))


if __name__ == "__main__":
    main()
