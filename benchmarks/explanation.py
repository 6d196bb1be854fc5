"""How long explanations take, all readings, intervals and directions included.

    python -m benchmarks.explanation

Instances of a grid of three causes, and of seven causes with levels of their own (127 settings
each), of 100 Gaussian runs a setting, three of which end in a wrong basin in every second setting,
as common random numbers have it; the processor's seconds of one process. Where ICPSHAP_REAL_DATA
names a folder with `apartment_pair`, also the seven-cause game of that pair, registrations
included.
"""

import json
import time

import numpy as np
import pandas as pd

from icpshap.estimators.kind import SAMPLES
from icpshap.explanation import games, shapley
from icpshap.explanation.method import Method
from icpshap.explanation.scan_pair import ScanPair
from icpshap.tables import INITIAL_XI, XI

RUNS = 100
SEED = 20260101
WRONG = [3, 41, 60]
OFFSET = np.array([0.1, 0.0, 0.05, 0.3, 0.1, 0.0])
DEVIATION = np.array([0.001, 0.002, 0.003, 0.003, 0.006, 0.01])
PAIR = ScanPair("made", 0, 1, 3.0, np.eye(4))
# Seven causes of which only the number matters here; off is 0.
CAUSES = tuple(f"cause_{k}" for k in range(7))


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


def main():
    found = {"seven_causes_cpu_seconds": None}
    for name, made in (("instances_1331_seconds", grid), ("instances_100_m7_seconds", apart)):
        found[name] = round(seconds(*made()), 2)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
