"""How long explanations take, all readings, intervals and directions included.

    python -m benchmarks.explanation

Instances of a grid of three causes, and of seven causes with levels of their own (127 settings
each), of 100 Gaussian runs a setting, three of which end in a wrong basin in every second setting,
as common random numbers have it; the processor's seconds of one process. Where ICPSHAP_REAL_DATA
names a folder with `apartment_pair`, also the game of seven causes of that pair: 128 settings of
100 runs, registrations included, imports and the compilation of the engine not.
"""

import json
import time

import numpy as np
import pandas as pd

from benchmarks import real_pairs
from icpshap.estimators.kind import SAMPLES
from icpshap.explanation import games, shapley
from icpshap.explanation.method import Method
from icpshap.explanation.scan_pair import ScanPair
from icpshap.presets import Preset
from icpshap.tables import INITIAL_XI, XI

RUNS = 100
SEED = real_pairs.SEED
WRONG = [3, 41, 60]
OFFSET = np.array([0.1, 0.0, 0.05, 0.3, 0.1, 0.0])
DEVIATION = np.array([0.001, 0.002, 0.003, 0.003, 0.006, 0.01])
PAIR = ScanPair("made", 0, 1, 3.0, np.eye(4))
# Seven causes of which only the number matters here; off is 0.
CAUSES = tuple(f"cause_{k}" for k in range(7))
# Of the real pair: levels, but for the overlap of which a share is removed, and the estimator.
LEVELS = {
    "sensor_noise": 0.05,
    "initial_pose": 2.0,
    "partial_overlap": 0.6,
    "under_constrained": 0.9,
    "icp_randomness": 5.0,
    "range_bias": 0.02,
    "motion_distortion": 0.02,
}
ROBUST = {
    "subsampling_probability": 0.25,
    "stop_rotation": 1e-5,
    "stop_translation": 1e-5,
    "noise_draws": 25,
    "overlap_shape": "sector",
    "covariance_floor_rotation": 1e-4,
    "covariance_floor_translation": 1e-3,
    "bias_correction": "jackknife",
    "wrong_basins": "leave_out",
}


def grid():
    """1,331 instances of three causes that share their settings."""
    levels = np.stack(np.meshgrid(*[np.linspace(0, 1, 11)] * 3, indexing="ij"), axis=-1)
    return CAUSES[:3], levels.reshape(-1, 3)


def apart():
    """100 instances of seven causes that share none but the clean setting."""
    return CAUSES, np.random.default_rng(SEED).uniform(0.1, 1.0, (100, 7))


def runs_table(causes, values):
    """Runs of every setting that the instances (i, M) need, and of the clean one again."""
    players = len(causes)
    generator = np.random.default_rng(SEED)
    settings = shapley.coalition_values(values, np.zeros(players)).reshape(-1, players)
    settings = np.concatenate([np.unique(settings, axis=0), np.zeros((1, players))])
    again = np.arange(len(settings)) == len(settings) - 1
    draws = generator.normal(size=(1 + players, RUNS, 6)) * DEVIATION
    xi = draws[0] + np.einsum("sa,ari->sri", settings, draws[1:])
    xi[again] = generator.normal(size=(RUNS, 6)) * DEVIATION
    xi[:, WRONG] += (generator.random((len(settings), len(WRONG), 1)) < 0.5) * OFFSET
    table = pd.DataFrame(xi.reshape(-1, 6), columns=XI)
    table[INITIAL_XI] = np.tile(draws[0], (len(settings), 1))
    table[list(causes)] = np.repeat(settings, RUNS, axis=0)
    runs = np.tile(np.arange(RUNS), len(settings))
    return table.assign(
        replicate=0, again=np.repeat(again, RUNS), run=runs, noise_draw=0, status="ok", weight=1.0
    )


def seconds(causes, values):
    """Seconds of the processor that explaining these instances takes."""
    instances = pd.DataFrame(values, columns=list(causes)).rename_axis("instance").reset_index()
    runs, off = runs_table(causes, values), dict.fromkeys(causes, 0.0)
    start = time.process_time()
    games.explain(runs, None, instances, off, SAMPLES, Method(), PAIR)
    return time.process_time() - start


def seconds_of_real_pair():
    """Seconds of the processor that the game of seven causes takes on the Apartment."""
    pair = real_pairs.real_pair("apartment")
    overlap = LEVELS["partial_overlap"] * pair.overlap
    levels = {**LEVELS, "partial_overlap": overlap}
    game = real_pairs.Game("apartment", pair, Preset.of(**ROBUST), levels)
    game.estimated(game.settings[:1])  # compiles
    start = time.process_time()
    game.explained(*game.estimated())
    return time.process_time() - start


def main():
    found = {"seven_causes_cpu_seconds": None}
    if real_pairs.folder():
        found["seven_causes_cpu_seconds"] = round(seconds_of_real_pair(), 1)
    for name, made in (("instances_1331_seconds", grid), ("instances_100_m7_seconds", apart)):
        found[name] = round(seconds(*made()), 2)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
