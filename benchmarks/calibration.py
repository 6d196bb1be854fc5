"""How often do the 95 % intervals contain the truth? Coverage on runs of known distribution.

    python benchmarks/calibration.py [--repetitions 1000]

A run's pose error is Gaussian. Each uncertainty source that is on adds a spread of its own, and
every setting has a little randomness that it shares with no other (the redrawn subsample). Sensor
noise also moves all runs of one noise draw together. Prints a table and, as its last line, JSON.
"""

from dataclasses import dataclass

import numpy as np

from icpshap import divergence, shapley
from icpshap.explanation import quantities
from icpshap.uncertainty import Method, Sample, estimate

RUNS = 100
SOURCES = ("sensor_noise", "initial_pose", "partial_overlap")
QUANTITIES = ("f", *(f"phi_{source}" for source in SOURCES))
ON = shapley.coalitions(3)
GAME = np.arange(8)[None]
OFFSET = np.array([0.1, 0.0, 0.05, 0.3, 0.1, 0.0])
WRONG_BASIN_RATE = 0.03
# Standard deviations [rad x3, m x3]: of every run, of every run and setting on its own, of what a
# source that is on adds, of what a noise draw adds to all its runs.
SHARED = 1e-3 * np.array([0.8, 0.9, 1.0, 1.5, 2.0, 1.0])
OWN = 0.4 * SHARED
ADDED = 1e-3 * np.array(
    [
        [2.0, 1.0, 1.5, 3.0, 3.0, 1.0],
        [0.0, 0.5, 0.2, 0.5, 0.0, 1.0],
        [0.8, 0.0, 1.2, 1.0, 2.0, 0.5],
    ]
)
DRAW = 0.5 * ADDED[0]


@dataclass(frozen=True)
class Case:
    """A way to draw the runs, and how they are read."""

    effects: bool
    common_random_numbers: bool
    wrong_basins: str  # none, keep, leave_out
    noise_draws: int
    interval: str
    deleted: str = "noise draws"  # or runs, wrongly, in spite of several noise draws

    @property
    def method(self):
        wrong_basins = "leave_out" if self.wrong_basins == "leave_out" else "keep"
        return Method(wrong_basins=wrong_basins, interval=self.interval)


def draw(case, generator):
    """A `Sample` of the 8 settings of a game."""
    settings = 1 if case.common_random_numbers else len(ON)
    shared = generator.normal(size=(settings, RUNS, 6)) * SHARED
    xi = shared + generator.normal(size=(len(ON), RUNS, 6)) * OWN
    noise_draw = np.arange(RUNS) * case.noise_draws // RUNS
    if case.effects:
        added = generator.normal(size=(settings, RUNS, 3, 6)) * ADDED
        offsets = generator.normal(size=(settings, case.noise_draws, 6)) * DRAW
        added[:, :, 0] += offsets[:, noise_draw]
        xi += np.einsum("sa,srai->sri", ON, np.broadcast_to(added, (len(ON), RUNS, 3, 6)))
    if case.wrong_basins != "none":
        wrong = generator.random((settings, RUNS, 1)) < WRONG_BASIN_RATE
        xi += wrong * OFFSET
    return Sample(
        sources=SOURCES,
        settings=ON.astype(float),
        draws=np.zeros(len(ON), dtype=int),
        xi=xi,
        initial_xi=xi,
        failed=np.zeros((len(ON), RUNS), dtype=bool),
        wrong_basin=divergence.wrong_basin(xi, 0.1, np.deg2rad(2.0)),
        noise_draw=noise_draw if case.deleted == "noise draws" else np.zeros_like(noise_draw),
    )


def truth(case):
    """The quantities that infinitely many runs would give (and noise draws, if more than one)."""
    variance = np.tile(SHARED**2 + OWN**2, (len(ON), 1))
    if case.effects:
        variance += ON @ ADDED**2
        if case.noise_draws > 1:
            variance += ON[:, :1] * DRAW**2
    covariance = variance[:, :, None] * np.eye(6) + divergence.floor_matrix(*case.method.floor)
    if case.wrong_basins == "keep":
        covariance += WRONG_BASIN_RATE * (1 - WRONG_BASIN_RATE) * np.outer(OFFSET, OFFSET)
    game = divergence.kullback_leibler(covariance[0], covariance)
    return quantities(game)[1:5]


def coverage(case, repetitions):
    """Share of intervals that hold the truth, and the means of value and half width, by quantity."""
    true = truth(case)
    inside, values, halves = [], [], []
    for repetition in range(repetitions):
        sample = draw(case, np.random.default_rng([20260101, repetition]))
        found = estimate(sample, GAME, quantities, case.method)
        low, high = found.low[0, 1:5], found.high[0, 1:5]
        inside.append((low <= true) & (true <= high))
        values.append(found.value[0, 1:5])
        halves.append((high - low) / 2)
    return {
        name: {
            "truth": round(float(true[q]), 4),
            "coverage": round(float(np.mean(inside, axis=0)[q]), 3),
            "mean": round(float(np.mean(values, axis=0)[q]), 4),
            "half_width": round(float(np.mean(halves, axis=0)[q]), 4),
        }
        for q, name in enumerate(QUANTITIES)
    }
