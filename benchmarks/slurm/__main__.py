"""Run the workflow through Slurm on this machine, disturb it, and measure what a job costs.

    python -m benchmarks.slurm [--keep FOLDER]

As root, after apt-get install slurm-wlm munge, and pip install snakemake-executor-plugin-slurm of
the version that profiles/slurm names; some 15 minutes. Starts a cluster of one node with two cores,
without systemd; runs tests/tiny.yaml through it and compares every parquet file with those of -j2;
then the cases of `cases.py`; then simulates the paper and a drive on more cores with the measured
costs. Prints tables and ends with a line of JSON; the exit code is 0 if all bytes were equal.
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import yaml
from tabulate import tabulate

from benchmarks import planned_work, scale
from benchmarks.faults.workplace import TINY, Workplace
from benchmarks.slurm import cases, meter
from benchmarks.slurm.cluster import Cluster
from benchmarks.slurm.simulation import Measured, simulated
from benchmarks.slurm.workplace import PROFILE, SlurmWorkplace
from icpshap.errors import UserError

CORES = (2, 100, 500)
RUNS_PER_JOB = (16_000, 4_000, 1_000)


def compared(folder):
    """The tiny workflow by -j2 and through Slurm.

    Whether bytes are equal, meter.JobCost's, seconds through Slurm, number of files.
    """
    config = yaml.safe_load(TINY.read_text(encoding="utf-8"))
    alone = Workplace.new(folder / "alone", config)
    code, said = alone.run()
    assert code == 0, said
    place = SlurmWorkplace.new(folder / "slurm", config)
    began = time.monotonic()
    with meter.Meter(place) as measuring:
        code, said = place.run()
    seconds = time.monotonic() - began
    assert code == 0, said
    return alone.bytes() == place.bytes(), measuring.costs(), seconds, len(alone.bytes())


def measured(costs):
    """What the simulation draws from: CPU seconds, which do not hang on who else was computing."""
    profile = yaml.safe_load((PROFILE / "profile.yaml").read_text(encoding="utf-8"))
    works = [cost.script_cpu for cost in costs if cost.rule == "run_icp"]
    return Measured(
        [cost.cpu_overhead for cost in costs],
        [work / median(works) for work in works],
        profile["seconds-between-status-checks"],
    )


def simulations(of_jobs):
    """A row for each plan, way to cut it, and number of cores."""
    plans = [
        ("the paper", number, planned_work.paper(runs_per_job=number)) for number in RUNS_PER_JOB
    ]
    drive = planned_work.over_paper(scale.configuration(scale.KITTI))
    for number in RUNS_PER_JOB[:2]:
        found = planned_work.tasks({**drive, "runs_per_job": number}, drive=True)
        plans.append((f"a drive of {scale.KITTI:,} scans", number, found))
    rows = []
    for name, number, tasks in plans:
        tasks = planned_work.submitted(tasks)
        for cores in CORES:
            found = simulated(tasks, cores, of_jobs)
            row = {"plan": name, "runs_per_job": number, "jobs": len(tasks), "cores": cores}
            row |= {"hours": found.hours, "core-hours of work": found.work}
            row["overhead of a core-hour, s"] = 3600 * found.overhead / found.work
            rows.append({**row, "share": found.share})
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--keep", type=Path, help="a folder to work in, which stays")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="slurm_workflow_") as folder:
        folder = arguments.keep or Path(folder)
        folder.mkdir(exist_ok=True)
        with Cluster() as cluster:
            equal, costs, seconds, files = compared(folder)
            print(
                f"{len(costs)} jobs, {files} parquet files, equal bytes: {equal}, {seconds:.0f} s"
            )
            print(tabulate(meter.by_rule(costs), headers="keys", tablefmt="github", floatfmt=".1f"))
            of_plans = simulations(measured(costs))
            print(tabulate(of_plans, headers="keys", tablefmt="github", floatfmt=".2f"))
            results = []
            for result in cases.all_tried(cluster, folder):
                print(result, flush=True)
                results.append(result)
        for result in cases.all_tried_elsewhere(folder):
            print(result, flush=True)
            results.append(result)
    rows = [{**result._asdict(), "equal": "yes" if result.equal else "NO"} for result in results]
    print(tabulate(rows, headers="keys", tablefmt="github", floatfmt=".0f"))
    found = {
        "bytes_equal": equal,
        "cases": len(results),
        "cases_equal": sum(result.equal for result in results),
        "overhead_seconds": median(cost.overhead for cost in costs),
        "overhead_cpu_seconds": median(cost.cpu_overhead for cost in costs),
    }
    found |= {f"paper_share_{row['cores']}": row["share"] for row in of_plans[: len(CORES)]}
    print(json.dumps({key: round(value, 3) for key, value in found.items()}), flush=True)
    return not (equal and found["cases_equal"] == len(results))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except UserError as error:
        sys.exit(str(error))
