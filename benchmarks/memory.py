"""How much memory does a registration job take, and how much should its rule ask for?

    python -m benchmarks.memory [--quick] [--largest 10000000]

A case is a pair of simulated scans of the apartment, of so many points each, and so many settings.
It is measured in a process of its own, which does what the rule's script does: it reads the scans
from tables, estimates the settings (`icpshap.estimators.estimate`) by the chain of the paper, and
writes the runs. Its peak is the operating system's count, imports and compiled code included; the
compilation itself, which costs 150 MB more once on a machine, is done before. What the rule asks
for is read from workflow/rules/registration.smk.

Prints a table and, as its last line, a JSON list of the cases. Takes half an hour and 5 GB, half of
it at 10 million points; `--largest 1000000` 7 minutes; `--quick` makes everything small.
"""

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

REPOSITORY = Path(__file__).parents[1]
sys.path.insert(0, str(REPOSITORY))  # python benchmarks/memory.py finds the library, too

from benchmarks import icp as benchmark  # noqa: E402

SEVEN_CAUSES = 2**7  # settings of one instance
MILLION = 1_000_000


class Case(NamedTuple):
    """A pair of scans, and what is estimated of it."""

    points: int  # of each scan
    settings: int
    runs: int  # of a setting
    probability: float  # with which a source point is used in a run
    iterations: int  # at most; few, where memory has reached its peak after few


CASES = [
    Case(100_000, 8, 100, 0.05, 20),
    Case(100_000, SEVEN_CAUSES, 100, 0.05, 10),
    Case(100_000, 2, 100, 1.0, 10),
    Case(MILLION, 8, 100, 0.05, 10),
    Case(MILLION, 2, 50, 1.0, 3),
    Case(10 * MILLION, 2, 50, 0.05, 3),
    Case(10 * MILLION, 1, 5, 1.0, 2),
]


def planned(number):
    """That many settings (a power of two): at most two noise levels, and levels of the others."""
    from icpshap.plan import Setting

    noises = [0.0, 0.05][: min(number, 2)]
    others = number // len(noises)
    poses = 2 ** (int(np.log2(others)) // 2)
    names = ("sensor_noise", "initial_pose", "partial_overlap")
    levels = (
        noises,
        np.linspace(1.5, 1.0, poses, endpoint=False),
        np.linspace(0.0, 0.2, others // poses, endpoint=False),
    )
    return [
        Setting(tuple(zip(names, map(float, values), strict=True))) for values in product(*levels)
    ]


def write_scans(folder, points):
    """The scans that a job reads, in this process."""
    from icpshap import tables

    reference, source, T = benchmark.simulated_pair("apartment", points)
    scans = [(0, reference, None, 0), (1, source, None, 0)]
    tables.write_scans(folder / "scans.parquet", scans, {})
    np.save(folder / "T.npy", T)


def job(folder, *case):
    """A registration job in this process: its peak memory and its time."""
    from icpshap import estimators, tables
    from icpshap.data.pair import Pair
    from icpshap.estimators.perturb import Perturbation, Streams

    case = Case(*case)
    options = {
        "runs": case.runs,
        "subsampling_probability": case.probability,
        "maximum_iterations": case.iterations,
    }
    estimator = estimators.Estimator.of("monte_carlo", options)
    settings = planned(case.settings)
    causes = list(settings[0].values)
    start = time.perf_counter()
    clouds = [tables.read_scan(folder / "scans.parquet", index)[0] for index in (0, 1)]
    overlapping = np.ones(len(clouds[1]), dtype=bool)  # measured by another rule
    pair = Pair(*clouds, np.load(folder / "T.npy"), overlapping, 0.2)
    runs, _ = estimators.estimate(
        pair,
        settings,
        estimator.of_causes(causes),
        Perturbation().deviation,
        Streams(1, "benchmark", 0, 1),
    )
    runs = runs.assign(reference=0, source=1)
    tables.write(folder / "runs.parquet", runs, "runs", causes=causes)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"peak_mb": peak, "seconds": time.perf_counter() - start}


def asked(points):
    """mem_mb of the rule for scans of so many points."""
    rules = (REPOSITORY / "workflow" / "rules" / "registration.smk").read_text()
    rule = rules[rules.index("rule run_icp:") :]
    base, per_million = re.search(r"mem_mb=memory_of_scans\((\d+), (\d+)\)", rule).groups()
    return int(base) + round(int(per_million) * points / MILLION)


def apart(function, *arguments):
    """One of the functions above, in a process of its own."""
    call = json.dumps([function, *map(str, arguments[:1]), *arguments[1:]])
    done = subprocess.run(
        [sys.executable, __file__, "--call", call], stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def measured(cases):
    """Each case with its peak, what the rule asks for, and its seconds."""
    with tempfile.TemporaryDirectory() as name:
        for points in sorted({case.points for case in cases}):
            folder = Path(name, str(points))
            folder.mkdir()
            apart("write_scans", folder, points)
            of_size = [case for case in cases if case.points == points]
            if of_size[0] == cases[0]:
                apart("job", folder, *cases[0]._replace(settings=1, runs=2))  # compiles, if need be
            for case in of_size:
                found = apart("job", folder, *case)
                yield case, found["peak_mb"], asked(points), found["seconds"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--largest", type=int, default=10 * MILLION, help="points of a scan")
    parser.add_argument("--call", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.call:
        function, folder, *arguments = json.loads(options.call)
        print(json.dumps(globals()[function](Path(folder), *arguments)))
        return
    cases = [case for case in CASES if case.points <= options.largest]
    if options.quick:
        cases = [case._replace(points=case.points // 100, runs=10) for case in cases]
    heading = (*Case._fields, "peak_mb", "mem_mb", "seconds")
    print(f"| {' | '.join(heading)} |\n|{'---|' * len(heading)}")
    rows = []
    for case, peak_mb, mem_mb, seconds in measured(cases):
        rows.append(
            dict(zip(heading, (*case, round(peak_mb), mem_mb, round(seconds, 1)), strict=True))
        )
        print("| " + " | ".join(str(value) for value in rows[-1].values()) + " |", flush=True)
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
