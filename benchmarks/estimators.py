"""What the estimators of uncertainty are worth: shares of the true variance, calibration, speed.

    python -m benchmarks.estimators [shares] [calibration] [speed] [lists] [--quick]

shares: what part of the variance of a clean setting each way of holding the sensor's own noise has,
by direction. The truth is the variance of runs each of which sees fresh noise on both scans; an
estimate sees one noisy pair, as a user does. calibration: how far a pose scatters over fresh noise,
in standard deviations of what the estimator says. speed: CPU seconds of a setting and of the
paper's two experiments, extrapolated from pairs of each size. lists: CPU seconds of a setting, of
the kinds that ask the engine for single matches, and with scipy's k-d tree in its place. Real scans
are those of the folder that ICPSHAP_REAL_DATA names; without it shares and calibration are of
simulated ones alone. The last line is JSON.
"""

import argparse
import json
import os
from dataclasses import replace
from pathlib import Path
from unittest import mock

import numpy as np
import yaml
from scipy.spatial import cKDTree
from tabulate import tabulate

from benchmarks import real_pairs
from benchmarks.icp import PAPER_PAIRS, Clock, simulated_pair
from icpshap import config, estimators, icp, plan
from icpshap.data import simulate
from icpshap.data.pair import Pair, relative_pose
from icpshap.estimators.kind import GOOD_STATUS
from icpshap.estimators.perturb import Streams
from icpshap.plan import Setting
from icpshap.presets import ROBUST
from icpshap.tables import COVARIANCE, XI

CONFIGURATIONS = ("config.yaml", "config/estimators.yaml")
INSTANCE = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
CLEAN = Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0, "partial_overlap": 0.0})
DIRECTIONS = ("roll", "pitch", "yaw", "x", "y", "z")
SCENES = {"apartment, simulated": "apartment", "plain, simulated": "plain"}
POINTS = 36_700  # of a simulated scan
SIGMAS = (0.01, 0.02)  # m
METRICS = ("point_to_plane", "point_to_point")
OBSERVED = 2  # noisy pairs, over which an estimate is averaged
SAMPLE = ROBUST.with_options(subsampling_probability=0.25, sensor_sigma=0.0, noise_draws=1)
WAYS = {
    "runs alone": {},
    "closed_form": {"sensor_noise_by": "closed_form"},
    "draws": {"sensor_noise_by": "draws", "noise_draws": 10},
}
MATCHING = ("closed_form", "gicp", "stein", "bayesian", "stein_newton")
TIMED = ("closed_form", "unscented", "gicp", "stein", "bayesian", "stein_newton")
# Kinds that start at the true pose: settings that differ in the initial pose are computed once.
FROM_TRUTH = ("closed_form", "gicp")
SIZES = (36_700, 130_000, 367_000)


def blocks():
    """The estimators of the configuration, by name."""
    merged = {}
    for path in CONFIGURATIONS:
        loaded = yaml.safe_load(Path(__file__).parents[1].joinpath(path).read_text("utf-8"))
        for key, value in loaded.items():
            merged[key] = {**merged.get(key, {}), **value} if isinstance(value, dict) else value
    return config.load(merged).estimators


# --- shares of the true variance ------------------------------------------------------------------


def bare_pair(scene):
    """A simulated `Pair` whose scans have no noise at all."""
    T = simulate.simulate_poses(scene, 2, seed=1)
    clouds = [simulate.simulate_scan(scene, k, T[k], 60_000, 1, (0.0, 0.0)) for k in range(2)]
    generator = np.random.default_rng(0)
    clouds = [cloud[np.sort(generator.permutation(len(cloud))[:POINTS])] for cloud in clouds]
    distance = real_pairs.PERTURBATION.overlap_distance
    return Pair.measured(*clouds, relative_pose(T, 0, 1), distance)


def pairs():
    found = {"apartment, real": real_pairs.real_pair("apartment")} if real_pairs.folder() else {}
    return found | {name: bare_pair(scene) for name, scene in SCENES.items()}


def estimated(name, pair, preset, setting=CLEAN):
    """The tables of runs and of estimates of one setting."""
    return real_pairs.Game(name, pair, preset, INSTANCE).estimated([setting])


def good_errors(runs):
    """Pose errors (k, 6) of the runs that are in the basin of most."""
    xi = runs.loc[runs["status"].isin(GOOD_STATUS), XI].to_numpy(dtype=float)
    away = np.abs(xi - np.median(xi, axis=0))
    return xi[(away[:, :3].max(axis=1) < np.deg2rad(2)) & (away[:, 3:].max(axis=1) < 0.1)]


def true_variance(name, pair, sigma, metric, number):
    """Variance (6,) of runs each of which sees noise of its own."""
    preset = SAMPLE.with_options(metric=metric, runs=number, noise_draws=number)
    noisy = Setting.at({**CLEAN.values, "sensor_noise": sigma})
    runs, _ = estimated(name, pair, preset, noisy)
    return good_errors(runs).var(axis=0, ddof=1)


def observed_pair(pair, sigma, number):
    """The pair as one measurement with noise shows it."""
    generator = np.random.default_rng([real_pairs.SEED, number])
    clouds = {
        scan: getattr(pair, scan) + sigma * generator.normal(size=getattr(pair, scan).shape)
        for scan in ("reference", "source")
    }
    return replace(pair, **clouds)


def said_variance(name, pair, sigma, metric, way):
    """Variance (6,) of the clean setting as an estimator says it, mean over noisy pairs."""
    options = {**WAYS[way], "sensor_sigma": sigma} if WAYS[way] else {}
    preset = SAMPLE.with_options(metric=metric, **options)
    found = []
    for number in range(OBSERVED):
        runs, estimates = estimated(name, observed_pair(pair, sigma, number), preset)
        variance = good_errors(runs).var(axis=0, ddof=1)
        if estimates is not None:
            variance = variance + covariances(estimates).mean(axis=0).diagonal()
        found.append(variance)
    return np.mean(found, axis=0)


def covariances(estimates):
    """Covariances (k, 6, 6) of a table of estimates."""
    result = np.zeros((len(estimates), 6, 6))
    row, column = np.triu_indices(6)
    result[:, row, column] = result[:, column, row] = estimates[COVARIANCE].to_numpy(dtype=float)
    return result


def shares(number):
    lines, figures = [], []
    for name, pair in pairs().items():
        for sigma in SIGMAS:
            for metric in METRICS:
                truth = true_variance(name, pair, sigma, metric, number)
                for way in WAYS:
                    share = said_variance(name, pair, sigma, metric, way) / truth
                    of = [name, f"{100 * sigma:g} cm", metric.replace("_", " "), way]
                    lines.append([*of, *(f"{part:.2f}" for part in share)])
                    figures.append([*of, *(round(float(part), 3) for part in share)])
    header = ["pair", "noise", "metric", "way", *DIRECTIONS]
    print(tabulate(lines, header, "pipe", disable_numparse=True), "\n")
    return {"shares_of_true_variance": figures}


# --- calibration ----------------------------------------------------------------------------------


def normalised_errors(name, pair, preset, sigma, draws):
    """Scatter of the pose over fresh noise in units of what is said: rotation, translation."""
    noisy = Setting.at({**CLEAN.values, "sensor_noise": sigma})
    runs, estimates = estimated(name, pair, preset.with_options(**_of_draws(preset, draws)), noisy)
    if estimates is None:
        of_draws = runs.groupby("noise_draw")[XI]
        said = of_draws.var(ddof=1).to_numpy()
        # A run is a pose; of particles and states of a chain their mean is.
        one_each = preset.estimator.returned.exchangeable
        poses = (runs[XI] if one_each else of_draws.mean()).to_numpy(dtype=float)
    else:
        poses = estimates[XI].to_numpy(dtype=float)
        said = np.diagonal(covariances(estimates), axis1=1, axis2=2)
    ratio = poses.var(axis=0, ddof=1) / np.nanmean(said, axis=0)
    return np.sqrt([ratio[:3].mean(), ratio[3:].mean()])


def _of_draws(preset, draws):
    """Options of so many noise draws, each with as many samples as one had."""
    options = {"noise_draws": draws}
    if "runs" in preset.options:
        options["runs"] = draws * preset.options["runs"]
    return options


def calibration(draws):
    """Clean: fresh noise of 1 cm, of which an estimator is told. Noisy: 5 cm besides."""
    pair = real_pairs.real_pair("apartment") if real_pairs.folder() else bare_pair("apartment")
    lines, figures = [], {}
    for name, preset in blocks().items():
        if name in ("released_code", "robust", "learned"):
            continue
        found = []
        for sigma in (0.01, 0.05):
            own = {"noise": "fixed"} if sigma == 0.01 and "noise" in preset.options else {}
            found += list(
                normalised_errors("apartment", pair, preset.with_options(**own), sigma, draws)
            )
        lines.append([name, *(f"{error:.2g}" for error in found)])
        figures[name] = [float(f"{error:.3g}") for error in found]
    header = [
        "estimator",
        *(f"{s}, {d}" for s in ("clean", "noisy") for d in ("rotation", "translation")),
    ]
    print(tabulate(lines, header, "pipe", disable_numparse=True), "\n")
    return {"normalised_errors": figures}


# --- speed ----------------------------------------------------------------------------------------


def cpu_seconds(pair, preset, settings):
    given = preset.estimator.of_causes(list(INSTANCE)), real_pairs.PERTURBATION.deviation
    with Clock() as clock:
        estimators.estimate(pair, settings, *given, Streams(1, "benchmark", 0, 1))
    return clock.seconds


def of_level(noise, poses, overlaps):
    """Settings of one noise level of the paper's grid."""
    return [
        Setting.at({"sensor_noise": noise, "initial_pose": s, "partial_overlap": o})
        for s in poses
        for o in overlaps
    ]


def speed(quick):
    """Minutes of the paper's two experiments on two cores, of each kind with one noise draw."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    game = plan.settings({name: (level,) for name, level in INSTANCE.items()}, 1)
    game = [setting for setting in game if not setting.again]
    lines, minutes = [], {}
    known = {scene_size: None for scene_size in PAPER_PAIRS} | {
        ("plain", size): None for size in SIZES[:2]
    }
    for scene, size in known:
        *clouds, T = simulated_pair_in_process(scene, size // (10 if quick else 1))
        known[scene, size] = Pair.measured(*clouds, T, real_pairs.PERTURBATION.overlap_distance)
    for name in TIMED:
        preset = blocks()[name].with_options(noise_draws=1)
        cpu_seconds(known["plain", SIZES[0]], preset, game[:1])  # compiles
        seconds = {key: cpu_seconds(pair, preset, game) for key, pair in known.items()}
        large = known["apartment", SIZES[-1]]
        total = sum(count * seconds[key] for key, count in PAPER_PAIRS.items())
        for noise, levels in ((0.0, 1), (0.05, 10)):
            one = cpu_seconds(large, preset, of_level(noise, [1.5], [0.05]))
            nine = cpu_seconds(large, preset, of_level(noise, [1.2, 1.5, 1.8], [0.02, 0.05, 0.08]))
            distinct = (3, 11) if preset.estimator.kind.name in FROM_TRUTH else (9, 121)
            total += levels * (one + (nine - one) / (distinct[0] - 1) * (distinct[1] - 1))
        minutes[f"paper_minutes_{name}"] = round(total / 2 / 60, 1)
        of_sizes = [
            seconds["plain", SIZES[0]],
            seconds["plain", SIZES[1]],
            seconds["apartment", SIZES[2]],
        ]
        lines.append([name, *(f"{s / len(game):.2f}" for s in of_sizes), f"{total / 120:.0f}"])
    header = ["estimator", *(f"{size:,} points" for size in SIZES), "minutes, 2 cores"]
    print(tabulate(lines, header, "pipe", disable_numparse=True), "\n")
    return minutes


class TreeMatcher(icp.Matcher):
    """The same matches out of scipy's k-d tree."""

    def __init__(self, reference, matches=1):
        super().__init__(reference, matches)
        self._rows = reference.tree.rows
        self._tree = cKDTree(reference.tree.points[:, :3])

    def __call__(self, points, limit=np.inf):
        points = points - self.reference.mean
        distance, found = self._tree.query(
            points, self.matches, distance_upper_bound=np.sqrt(limit) * (1.0 + 1e-12)
        )
        distance, found = (each.reshape(len(points), -1) for each in (distance**2, found))
        made = np.isfinite(distance)
        return distance, np.where(made, self._rows[np.where(made, found, 0)], -1)


def lists(quick):
    """CPU seconds of a setting with the engine's lists, and with a k-d tree instead."""
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    game = [CLEAN, Setting.at(INSTANCE)]
    lines, ratios = [], {}
    for size in SIZES[:2]:
        *clouds, T = simulated_pair_in_process("plain", size // (10 if quick else 1))
        pair = Pair.measured(*clouds, T, real_pairs.PERTURBATION.overlap_distance)
        for name in MATCHING:
            preset = blocks()[name].with_options(noise_draws=1)
            cpu_seconds(pair, preset, game[:1])  # compiles
            with_lists = cpu_seconds(pair, preset, game)
            with mock.patch.object(icp, "Matcher", TreeMatcher):
                with_tree = cpu_seconds(pair, preset, game)
            ratios[f"lists_gain_{name}_{size}"] = round(with_tree / with_lists, 2)
            each = [seconds / len(game) for seconds in (with_lists, with_tree)]
            lines.append([name, f"{size:,}", *map("{:.2f}".format, each), with_tree / with_lists])
    header = ["estimator", "points", "lists, s a setting", "k-d tree, s", "gain"]
    print(tabulate(sorted(lines), header, "pipe", floatfmt=".2f"), "\n")
    return ratios


def simulated_pair_in_process(scene, points):
    """`simulated_pair`, which sets the resolution of the laser for the process, and back."""
    resolution = simulate.FULL_RESOLUTION
    try:
        return simulated_pair(scene, points)
    finally:
        simulate.FULL_RESOLUTION = resolution


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["shares", "calibration", "speed", "lists"])
    parser.add_argument("--quick", action="store_true", help="small numbers, to try the program")
    given = parser.parse_args()
    figures = {}
    if "shares" in given.parts:
        figures |= shares(50 if given.quick else 200)
    if "calibration" in given.parts:
        figures |= calibration(3 if given.quick else 20)
    if "speed" in given.parts:
        figures |= speed(given.quick)
    if "lists" in given.parts:
        figures |= lists(given.quick)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
