"""How fast is the ICP engine, and against what?

    python -m benchmarks.icp [--quick]

Every measurement is a process of its own on one core; times are process CPU times, and ratios are
between measurements of one process. Scans are simulated (`icpshap.simulate`) and thinned to the
size asked for; at most 5 % of their points lie within 1 m. Prints tables and, as its last line, a
JSON object with the figures; writes docs/icp_cost.svg. `--quick` makes everything small.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

BEAMS_PER_POINT = {"apartment": 1.35, "plain": 1.7}
PAPER_GRID = (11, 11, 11)
# Consecutive pairs and points a scan of the eight sequences (their data sheet; DATASET page).
PAPER_PAIRS = [
    (44, 367e3),
    (35, 170e3),
    (30, 170e3),
    (30, 94e3),
    *[(k, 170e3) for k in (31, 30, 36, 31)],
]
OTHERS_RUNS = 4  # runs of the other programs; all their runs cost the same
ITERATIONS, DISTANCE = 30, 1.0


def simulated_pair(scene, points):
    """(reference, source, T_reference_source) with that many points a scan."""
    from icpshap import se3, simulate

    # The laser's own resolution for that many points: the scanner's, then thinned.
    beams = max(1.0, points * BEAMS_PER_POINT[scene] / np.prod(simulate.FULL_RESOLUTION))
    simulate.FULL_RESOLUTION = tuple(
        int(np.ceil(n * np.sqrt(beams))) for n in simulate.FULL_RESOLUTION
    )
    T = simulate.simulate_poses(scene, 2, seed=1)
    full = int(np.prod(simulate.FULL_RESOLUTION))
    clouds = [simulate.simulate_scan(scene, k, T[k], full, seed=1) for k in range(2)]
    rng = np.random.default_rng(0)
    clouds = [c[np.sort(rng.permutation(len(c))[:points])] for c in clouds]
    assert all(len(c) == points for c in clouds)
    assert all((np.linalg.norm(c, axis=1) <= 1.0).mean() <= 0.05 for c in clouds)
    return *clouds, se3.inverse(T[0]) @ T[1]


def initial_poses(T, runs, seed=0):
    """T_gt exp(xi) as in the paper."""
    from icpshap import se3

    deviation = np.repeat([np.deg2rad(10.0), 0.2], 3) / np.sqrt(3.0)
    return T @ se3.exp(np.random.default_rng(seed).normal(size=(runs, 6)) * deviation)


class Clock:
    """CPU seconds of this process."""

    def __enter__(self):
        self.start = time.process_time()
        return self

    def __exit__(self, *_):
        self.seconds = time.process_time() - self.start


def warm_up(icp):
    """Compile, or load what has been compiled."""
    cloud = np.random.default_rng(0).random((5000, 3))
    for minimiser in (icp.PointToPlane(), icp.PointToPoint()):
        icp.register(
            icp.Reference(cloud), cloud, [np.arange(5000)], np.eye(4)[None], icp.Chain(minimiser)
        )


def against_others(scene, points, planes, runs):
    """Seconds a run on full clouds: ours with everything included, Open3D, small_gicp."""
    from icpshap import icp
    from icpshap.open3d_loader import load_open3d

    open3d = load_open3d()
    import small_gicp

    reference, source, T = simulated_pair(scene, points)
    T_initial = initial_poses(T, runs)
    warm_up(icp)
    minimiser = icp.PointToPlane() if planes else icp.PointToPoint()
    stopping = icp.Stopping(ITERATIONS, 0.0, 0.0)
    chain = icp.Chain(minimiser, 1, icp.Trimmed(1.0), DISTANCE, stopping)
    with Clock() as ours:
        target = icp.Reference(reference)
        result = icp.register(target, source, [np.arange(len(source))] * runs, T_initial, chain)
    registration = open3d.pipelines.registration
    method = registration.TransformationEstimationPointToPoint()
    clouds = [
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(c)) for c in (source, reference)
    ]
    if planes:
        normals = np.empty_like(reference)
        normals[target.tree.index] = target.normals
        clouds[1].normals = open3d.utility.Vector3dVector(normals)
        method = registration.TransformationEstimationPointToPlane()
    criteria = registration.ICPConvergenceCriteria(0.0, 0.0, ITERATIONS)
    others = min(OTHERS_RUNS, runs)
    with Clock() as theirs:
        poses = [
            registration.registration_icp(*clouds, DISTANCE, T0, method, criteria).transformation
            for T0 in T_initial[:others]
        ]
    with Clock() as small:
        for T0 in T_initial[:others]:
            small_gicp.align(
                reference,
                source,
                T0,
                registration_type="PLANE_ICP" if planes else "ICP",
                downsampling_resolution=1e-4,
                max_correspondence_distance=DISTANCE,
                max_iterations=ITERATIONS,
            )
    return {
        "ours": ours.seconds / runs,
        "open3d": theirs.seconds / others,
        "small_gicp": small.seconds / others,
        "difference": float(np.abs(np.array(poses) - result.T_reference_source[:others]).max()),
    }


def write_tables(folder, scene, points):
    """The tables a registration job reads."""
    from icpshap import perturbation, tables

    reference, source, T = simulated_pair(scene, points)
    for name, cloud in (("reference", reference), ("source", source)):
        tables.write(folder / f"{name}.parquet", tables.points_frame(cloud), "scan")
    near = perturbation.nearest_distances(reference, source, T) <= 0.2
    np.savez(folder / "pair.npz", T=T, near=near)


def job(folder, noise, scales, reductions):
    """A registration job as the workflow runs it: all CPU time, and that of the ICP iterations."""
    import yaml

    from icpshap import estimators, perturbation, plan, settings, tables
    from icpshap.icp import registration

    iterating = []
    original = registration.KeptLinks.__call__

    def timed(self, *arguments):
        with Clock() as clock:
            sums = original(self, *arguments)
        iterating.append(clock.seconds)
        return sums

    registration.KeptLinks.__call__ = timed
    config = yaml.safe_load(Path(__file__).parents[1].joinpath("config.yaml").read_text())
    config = settings.load(config)
    given = np.load(folder / "pair.npz")
    clouds = [tables.read_points(folder / f"{name}.parquet") for name in ("reference", "source")]
    pair = perturbation.Pair(*clouds, given["T"], given["near"])
    runs = estimators.register_settings(
        pair,
        [plan.Setting((n, s, r)) for n in noise for s in scales for r in reductions],
        config.estimators["paper"].registration,
        config.perturbation,
        perturbation.Streams(1, "benchmark", 0, 1),
    )
    tables.write(folder / "runs.parquet", runs, "runs")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "runs": len(runs),
        "iterations": float(runs["iterations"].mean()),
        "iterating": sum(iterating),
        "total": time.process_time(),  # since the process began: imports and all
        "peak_memory_mb": peak,
    }


def cost(points, runs):
    """CPU seconds of index and normals, of `register`, for the paper's chain."""
    from icpshap import icp

    reference, source, T = simulated_pair("apartment", points)
    warm_up(icp)
    with Clock() as index:
        target = icp.Reference(reference[icp.minimum_range(reference, 1.0)])
        _ = target.normals
    usable = np.flatnonzero(icp.minimum_range(source, 1.0))
    rng = np.random.default_rng(0)
    rows = [usable[rng.random(len(usable)) < 0.05] for _ in range(runs)]
    with Clock() as iterating:
        result = icp.register(target, source, rows, initial_poses(T, runs), icp.Chain())
    return {"index": index.seconds, "register": iterating.seconds / result.iterations.sum()}


def measure(name, *arguments):
    """Run one of the functions above in a process of its own, on one core."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    call = json.dumps([name, *arguments])
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.icp", "--measure", call],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env=environment,
    )
    return json.loads(done.stdout.splitlines()[-1])


def measured(call):
    """In that process: one core, one function."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    name, *arguments = json.loads(call)
    if name in ("job", "write_tables"):
        arguments[0] = Path(arguments[0])
    print(json.dumps(globals()[name](*arguments)))


def table(title, heading, rows):
    print(f"\n{title}\n\n| {' | '.join(heading)} |\n|{'---|' * len(heading)}")
    for row in rows:
        print("| " + " | ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in row) + " |")


def compare(scale, runs):
    """Against Open3D and small_gicp: the table's rows and the ratios."""
    rows, figures = [], {}
    for key, scene, points, planes in (
        ("open3d_point_to_point_365k", "apartment", 365_000, False),
        ("open3d_point_to_point_130k", "plain", 130_000, False),
        ("open3d_point_to_plane_365k", "apartment", 365_000, True),
    ):
        m = measure("against_others", scene, points // scale, planes, runs)
        figures[key] = m["open3d"] / m["ours"]
        metric = "plane" if planes else "point"
        rows.append(
            (
                f"{points // scale} points, {metric}",
                m["ours"],
                m["open3d"],
                m["small_gicp"],
                figures[key],
                m["difference"],
            )
        )
    table(
        f"CPU seconds a run of {ITERATIONS} iterations, {runs} runs, index included",
        (
            "case",
            "icpshap",
            "Open3D",
            "small_gicp (other optimiser and stop)",
            "times Open3D",
            "largest pose difference to Open3D",
        ),
        rows,
    )
    return figures


def jobs(scale, levels):
    """The paper's jobs: a noise level of the grid, and a whole pair, at each size."""
    rows, figures, pairs, grid = [], {}, {}, {}
    scales = np.linspace(1.0, 2.0, levels).tolist()
    with tempfile.TemporaryDirectory() as name:
        for points, scene in ((367_000, "apartment"), (130_000, "plain")):
            folder = Path(name, str(points))
            folder.mkdir()
            measure("write_tables", str(folder), scene, points // scale)
            cases = {"pair": ([0.0, 0.05], [1.0, 1.5], [0.0, 0.05])}
            if points == 367_000:
                measure("job", str(folder), [0.0], [1.0], [0.0])  # fills the compilation cache
                cases |= {
                    "clean level": ([0.0], scales, [0.0]),
                    "noisy level": ([0.05], scales, [0.0]),
                }
            for case, settings in cases.items():
                m = measure("job", str(folder), *settings)
                share = 1 - m["iterating"] / m["total"]
                if case == "pair":
                    pairs[points] = m
                else:
                    grid[case] = m
                rows.append(
                    (
                        f"{points // scale} points, {case}",
                        m["runs"],
                        m["iterations"],
                        m["total"],
                        m["runs"] / m["total"],
                        share,
                        m["peak_memory_mb"],
                    )
                )
    table(
        "Jobs of the estimator `paper`, one core",
        ("job", "runs", "mean iterations", "CPU s", "runs a second", "overhead", "peak MB"),
        rows,
    )
    levels_run = PAPER_GRID[1] * PAPER_GRID[2] * 100
    # A level's overhead is paid once for each of its jobs of about 4,000 runs.
    level = {
        case: (m["total"] - m["iterating"]) * levels_run / 4000
        + m["iterating"] / m["runs"] * levels_run
        for case, m in grid.items()
    }
    seconds = level["clean level"] + (PAPER_GRID[0] - 1) * level["noisy level"]
    small, large = pairs[130_000]["total"], pairs[367_000]["total"]
    for count, points in PAPER_PAIRS:
        seconds += count * max(0.0, small + (large - small) * (points - 130e3) / (367e3 - 130e3))
    figures["paper_chain_runs_per_core_second"] = {
        case.split()[0]: m["runs"] / m["total"] for case, m in grid.items()
    }
    figures["paper_hours_2_cores"] = seconds / 2 / 3600
    figures["peak_memory_mb"] = max(m["peak_memory_mb"] for m in [*grid.values(), pairs[367_000]])
    figures["overhead_share"] = {
        "367000_grid": 1 - grid["noisy level"]["iterating"] / grid["noisy level"]["total"],
        "130000_pair": 1 - pairs[130_000]["iterating"] / pairs[130_000]["total"],
    }
    return figures


def growth(sizes, runs):
    """Cost against the number of points and of runs: a table and docs/icp_cost.svg."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "icpshap"
    from matplotlib import pyplot

    by_size = [measure("cost", n, 100) for n in sizes]
    by_runs = [measure("cost", sizes[len(sizes) // 2], n) for n in runs]
    table(
        "Against points, 100 runs",
        ("points", "index and normals, s", "ms an iteration and run"),
        [(n, m["index"], m["register"] * 1e3) for n, m in zip(sizes, by_size, strict=True)],
    )
    table(
        f"Against runs, {sizes[len(sizes) // 2]} points",
        ("runs", "ms an iteration and run"),
        [(n, m["register"] * 1e3) for n, m in zip(runs, by_runs, strict=True)],
    )
    figure, axes = pyplot.subplots(1, 2, figsize=(9, 3.5), layout="constrained")
    axes[0].loglog(sizes, [m["index"] for m in by_size], "o-", label="index and normals [s]")
    axes[0].loglog(
        sizes, [m["register"] * 1e3 for m in by_size], "s-", label="iteration [ms a run]"
    )
    axes[0].set(xlabel="points a scan")
    axes[0].legend()
    axes[1].semilogx(runs, [m["register"] * 1e3 for m in by_runs], "s-")
    axes[1].set(xlabel="runs", ylabel="iteration [ms a run]", ylim=(0, None))
    docs = Path(__file__).parents[1] / "docs"
    figure.savefig(docs / "icp_cost.svg", metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a twentieth of the points, few runs")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measured(arguments.measure)
        return
    scale = 20 if arguments.quick else 1
    figures = compare(scale, 10 if arguments.quick else 100)
    figures |= jobs(scale, 2 if arguments.quick else 11)
    if not arguments.quick:
        growth([10_000, 30_000, 100_000, 300_000, 1_000_000], [10, 30, 100, 300, 1000])
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
