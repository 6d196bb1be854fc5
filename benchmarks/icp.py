"""How fast is the ICP engine, and against what?

    python -m benchmarks.icp [--quick]

Every measurement is a process of its own on one core; times are process CPU times. Scans are
simulated (`icpshap.simulate`) and thinned to the size asked for; at most 5 % of their points lie
within 1 m. First the jobs of the paper with the engine as it was at BEFORE, in turn with today's,
so that their ratio holds on any machine. Prints tables and, as its last line, JSON with the
figures; writes docs/icp_cost.svg. Takes about half an hour; `--quick` makes everything small,
`--gains` stops after the first table.
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

REPOSITORY = Path(__file__).parents[1]
BEFORE = "a90465f"  # commit with the engine that summed link by link
# The library that is measured; python benchmarks/icp.py finds it, too.
LIBRARY = os.environ.get("ICPSHAP_LIBRARY", str(REPOSITORY))
sys.path.insert(0, LIBRARY)
BEAMS_PER_POINT = {"apartment": 1.35, "stairwell": 1.35, "plain": 1.7}
# Consecutive pairs of the eight sequences by the size of their scans and by the scene that stands
# for them: Apartment; ETH and Stairs; Mountain; Gazebo and Wood in two seasons each.
PAPER_PAIRS = {
    ("apartment", 367_000): 44,
    ("stairwell", 170_000): 35 + 30,
    ("plain", 94_000): 30,
    ("plain", 170_000): 31 + 30 + 36 + 31,
}
OTHERS_RUNS = {"open3d": 20, "small_gicp": 4}  # of the 100: each of their runs starts afresh
ITERATIONS, DISTANCE = 30, 1.0
GRID_RUNS = 4100  # of a grid job here: a third of the workflow's, which hold a whole noise level


def simulated_pair(scene, points):
    """(reference, source, T_reference_source) with that many points a scan."""
    from icpshap import se3
    from icpshap.data import simulate

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
    from icpshap.data.open3d_loader import load_open3d

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
        normals[target.tree.rows] = target.normals
        clouds[1].normals = open3d.utility.Vector3dVector(normals)
        method = registration.TransformationEstimationPointToPlane()
    criteria = registration.ICPConvergenceCriteria(0.0, 0.0, ITERATIONS)
    chosen = {name: np.arange(0, runs, -(-runs // number)) for name, number in OTHERS_RUNS.items()}
    with Clock() as theirs:
        poses = [
            registration.registration_icp(*clouds, DISTANCE, T0, method, criteria).transformation
            for T0 in T_initial[chosen["open3d"]]
        ]
    with Clock() as small:
        for T0 in T_initial[chosen["small_gicp"]]:
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
        "open3d": theirs.seconds / len(poses),
        "small_gicp": small.seconds / len(chosen["small_gicp"]),
        "difference": np.abs(np.array(poses) - result.T_reference_source[chosen["open3d"]]).max(),
    }


def write_pair(folder, scene, points):
    """The pair that a registration job is about, as any version of the library can read it."""
    from icpshap.data.pair import Pair

    reference, source, T = simulated_pair(scene, points)
    near = Pair.measured(reference, source, T, 0.2).overlapping
    np.savez(folder / "pair.npz", reference=reference, source=source, T=T, near=near)


def planned(kind, number=None):
    """Settings of a registration job of the paper.

    "pair": a pair of `same_perturbation`; "clean", "noisy": a job of the grid at 0 and 0.05 m;
    "level": that many settings of the noisy level, spread evenly.
    """
    from icpshap import plan

    config = paper()
    if kind == "pair":
        levels = config.experiments["same_perturbation"].levels
        return [setting for setting in plan.settings(levels, 1) if not setting.again]
    grid = config.experiments["different_perturbations"].levels
    noise = 0.0 if kind == "clean" else 0.05
    if kind == "level":
        level = [s for s in plan.settings(grid, 1) if s.values["sensor_noise"] == noise]
        return [level[k] for k in np.linspace(0, len(level) - 1, number).astype(int)]
    runs = config.estimators["paper"].estimator.number_of_runs
    settings = plan.settings(grid, 1)
    jobs = plan.jobs([(0, 1)], grid, 1, runs, GRID_RUNS)
    return next(
        job
        for job in (settings[part.start : part.stop] for (part,) in jobs)
        if all(s.values["sensor_noise"] == noise and not s.again for s in job)
    )


def paper():
    import yaml

    from icpshap import config

    return config.load(yaml.safe_load(Path(LIBRARY, "config.yaml").read_text(encoding="utf-8")))


def job(folder, kind, number=None):
    """A registration job as the workflow runs it: all CPU time, and that of the ICP iterations."""
    from icpshap import estimators, tables
    from icpshap.data.pair import Pair
    from icpshap.estimators.perturb import Streams
    from icpshap.icp import registration

    iterating = []
    original = registration.KeptLinks.__call__

    def timed(self, *arguments):
        with Clock() as clock:
            sums = original(self, *arguments)
        iterating.append(clock.seconds)
        return sums

    registration.KeptLinks.__call__ = timed
    given = np.load(folder / "pair.npz")
    pair = Pair(given["reference"], given["source"], given["T"], given["near"], 0.2)
    config = paper()
    causes = config.experiments["same_perturbation"].causes
    runs, _ = estimators.estimate(
        pair,
        planned(kind, number),
        config.estimators["paper"].estimator.of_causes(causes),
        config.perturbation.deviation,
        Streams(config.seed, "benchmark", 0, 1),
    )
    runs = runs.assign(reference=0, source=1)
    tables.write(folder / "runs.parquet", runs, "runs", causes=causes)
    total = time.process_time()  # since the process began: imports and all
    return {
        "runs": len(runs),
        "iterations": runs["iterations"].mean(),
        "total": total,
        "overhead": 1.0 - sum(iterating) / total,
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
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


def measure(name, *arguments, library=LIBRARY):
    """Run one of the functions above in a process of its own, on one core."""
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment = {**os.environ, **threads, "ICPSHAP_LIBRARY": str(library)}
    call = json.dumps([name, *arguments])
    done = subprocess.run(
        [sys.executable, __file__, "--measure", call],
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
    if name in ("job", "write_pair"):
        arguments[0] = Path(arguments[0])
    print(json.dumps(globals()[name](*arguments), default=float))


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
        f"CPU seconds a run of {ITERATIONS} iterations, index included; {runs} runs of icpshap, at "
        f"most {OTHERS_RUNS['open3d']} of Open3D, {OTHERS_RUNS['small_gicp']} of small_gicp",
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


def jobs(scale):
    """The paper's jobs: of the grid, and a whole pair at each size."""
    done = {}
    with tempfile.TemporaryDirectory() as name:
        for scene, points in (*PAPER_PAIRS, ("plain", 130_000)):
            folder = Path(name, f"{scene}{points}")
            folder.mkdir()
            measure("write_pair", str(folder), scene, points // scale)
            if not done:
                measure("job", str(folder), "level", 1)  # fills the compilation cache
            kinds = ("clean", "noisy", "pair") if points == 367_000 else ("pair",)
            for kind in kinds:
                done[scene, points, kind] = measure("job", str(folder), kind)
    columns = ("runs", "iterations", "total", "overhead", "peak_memory_mb")
    table(
        "Jobs of the estimator `paper`, one core",
        ("job", "runs", "mean iterations", "CPU s", "overhead", "peak MB", "runs a second"),
        [
            (f"{scene}, {points // scale} points, {kind}", *(m[c] for c in columns), speed(m))
            for (scene, points, kind), m in done.items()
        ],
    )
    clean, noisy = (done["apartment", 367_000, kind] for kind in ("clean", "noisy"))
    grid = paper().experiments["different_perturbations"].levels
    level_runs = 100 * len(grid["initial_pose"]) * len(grid["partial_overlap"])
    seconds = level_runs / speed(clean)
    seconds += (len(grid["sensor_noise"]) - 1) * level_runs / speed(noisy)
    for size, count in PAPER_PAIRS.items():
        seconds += count * done[*size, "pair"]["total"]
    return {
        "paper_chain_runs_per_core_second": {"clean": speed(clean), "noisy": speed(noisy)},
        "paper_chain_mean_iterations": {"clean": clean["iterations"], "noisy": noisy["iterations"]},
        "paper_hours_2_cores": seconds / 2 / 3600,
        "peak_memory_mb": max(m["peak_memory_mb"] for m in done.values()),
        "overhead_share": {
            "367000_grid": max(clean["overhead"], noisy["overhead"]),
            "130000_pair": done["plain", 130_000, "pair"]["overhead"],
        },
    }


def library_before(folder):
    """The library at BEFORE, written into a folder; None where its commit is not at hand."""
    archive = ["git", "-C", str(REPOSITORY), "archive", BEFORE, "icpshap", "config", "config.yaml"]
    done = subprocess.run(archive, capture_output=True, check=False)
    if done.returncode:
        print(f"No gains: commit {BEFORE} is not in this clone.")
        return None
    subprocess.run(["tar", "-x", "-C", folder], input=done.stdout, check=True)
    return folder


def gains(scale, repeat=2):
    """CPU time of jobs before, over that of today: fastest of some, in turn."""
    rows, figures = [], {}
    with tempfile.TemporaryDirectory() as old, tempfile.TemporaryDirectory() as folder:
        before = library_before(old)
        if before is None:
            return figures
        measure("write_pair", folder, "apartment", 367_000 // scale)
        for library in (before, LIBRARY):
            measure("job", folder, "level", 1, library=library)  # fills the compilation cache
        for kind in ("pair", "clean", "noisy"):
            jobs = [
                [measure("job", folder, kind, library=one) for one in (before, LIBRARY)]
                for _ in range(repeat)
            ]
            then, now = (
                min(turns, key=lambda job: job["total"]) for turns in zip(*jobs, strict=True)
            )
            gain = then["total"] / now["total"]
            figures["gain_pair" if kind == "pair" else f"gain_grid_{kind}"] = gain
            beside = [job["total"] * job["overhead"] for job in (then, now)]
            peak = [round(job["peak_memory_mb"]) for job in (then, now)]
            rows.append((kind, then["total"], now["total"], gain, *beside, *peak))
    heading = ("job", f"CPU s at {BEFORE}", "CPU s", "gain", "not ICP iterations, s, then", "now")
    heading += ("peak memory, MB, then", "now")
    table("Jobs of the paper on 367,000 points, before and now", heading, rows)
    return figures


def explanation():
    """Wall seconds of `icpshap explain` on the real spinning pair, if it is at hand."""
    from benchmarks.one_pair import seconds, write

    if "ICPSHAP_REAL_DATA" not in os.environ:
        print("No explanation: ICPSHAP_REAL_DATA does not name a folder.")
        return {}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "icpshap", "explain", *write(folder, "spinning")]
        found = seconds(command, 4)
    print(f"\n`icpshap explain` of the spinning pair, two threads: {found:.2f} s")
    return {"explanation_seconds_spinning": found}


def speed(job):
    """Runs a core-second."""
    return job["runs"] / job["total"]


def growth(sizes, runs, settings):
    """Cost against the number of points, runs and settings: tables and docs/icp_cost.svg."""
    middle = sizes[len(sizes) // 2]
    by_size = [measure("cost", n, 100) for n in sizes]
    by_runs = [measure("cost", middle, n) for n in runs]
    with tempfile.TemporaryDirectory() as folder:
        measure("write_pair", folder, "apartment", middle)
        by_settings = [measure("job", folder, "level", n) for n in settings]
    table(
        "Against points, 100 runs",
        ("points", "index and normals, s", "ms an iteration and run"),
        [(n, m["index"], m["register"] * 1e3) for n, m in zip(sizes, by_size, strict=True)],
    )
    table(
        f"Against runs, {middle} points",
        ("runs", "ms an iteration and run"),
        [(n, m["register"] * 1e3) for n, m in zip(runs, by_runs, strict=True)],
    )
    table(
        f"Against settings of one noise level, 100 runs each, {middle} points",
        ("settings", "CPU s of the job", "of these a setting"),
        [(n, m["total"], m["total"] / n) for n, m in zip(settings, by_settings, strict=True)],
    )
    draw_growth(
        (sizes, [m["index"] for m in by_size], [m["register"] * 1e3 for m in by_size]),
        (runs, [m["register"] * 1e3 for m in by_runs]),
        (settings, [m["total"] for m in by_settings]),
    )


def draw_growth(by_size, by_runs, by_settings):
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams["svg.hashsalt"] = "icpshap"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(12, 3.5), layout="constrained")
    n, *costs = (np.array(values, dtype=float) for values in by_size)
    labels = ("index and normals [s]", "an iteration of a run [ms]")
    for cost, style, label in zip(costs, ("o-", "s-"), labels, strict=True):
        axes[0].loglog(n, cost, style, label=label)
        (bound,) = axes[0].loglog(n, cost[0] * n * np.log(n) / (n[0] * np.log(n[0])), "k:", lw=1)
    bound.set_label("n log n through the first point")
    axes[0].set(xlabel="points a scan", ylabel="CPU time", ylim=(None, 500.0))
    axes[0].legend(loc="upper left")
    axes[1].semilogx(*by_runs, "s-")
    axes[1].set(xlabel="runs", ylabel="an iteration of a run [ms]", ylim=(0, None))
    axes[2].plot(*by_settings, "s-")
    axes[2].set(xlabel="settings of 100 runs", ylabel="job [s]", xlim=(0, None), ylim=(0, None))
    figure.savefig(REPOSITORY / "docs" / "icp_cost.svg", metadata={"Date": None})


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a twentieth of the points, few runs")
    parser.add_argument("--gains", action="store_true", help="nothing but before and now")
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        measured(arguments.measure)
        return
    scale = 20 if arguments.quick else 1
    figures = gains(scale)
    if arguments.gains:
        print(json.dumps(figures))
        return
    figures |= explanation()
    figures |= compare(scale, 10 if arguments.quick else 100)
    figures |= jobs(scale)
    if not arguments.quick:
        growth(
            sizes=[10_000, 30_000, 100_000, 300_000, 1_000_000],
            runs=[10, 30, 100, 300, 1000],
            settings=[1, 4, 11, 41],
        )
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
