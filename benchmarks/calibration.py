"""How often do the 95 % intervals contain the truth? Coverage on runs of known distribution.

    python -m benchmarks.calibration [--repetitions 1000]

A run's pose error is Gaussian. Each cause that is on adds a spread of its own, and
every setting has a little randomness that it shares with no other (the redrawn subsample). Sensor
noise also moves all runs of one noise draw together. With one noise draw the truth is that of this
draw, with ten that of all possible draws. Prints a table and, as its last line, JSON; the exit code
tells whether the requirement on the jackknife, which the tables use, is met: at least 0.95 where
there are no effects, and 0.92 to 0.98 where there are and random numbers are common.
"""

import argparse
import itertools
import json
import sys
import time
from dataclasses import asdict, dataclass

import numpy as np

from icpshap.estimators.kind import SAMPLES
from icpshap.explanation import readings, shapley
from icpshap.explanation.basins import find_basins
from icpshap.explanation.games import quantities
from icpshap.explanation.intervals import CONFIDENCE
from icpshap.explanation.method import Method
from icpshap.explanation.sample import Sample
from icpshap.explanation.uncertainty import estimate

RUNS = 100
LENGTH = 3.0  # m, the characteristic length
WRONG_BASINS = ("none", "keep", "leave_out")
CAUSES = ("sensor_noise", "initial_pose", "partial_overlap")
QUANTITIES = (
    "f",
    *(f"phi_{cause}" for cause in CAUSES),
    *(f"interaction_{a}_{b}" for a, b in shapley.couples(CAUSES)),
)
READ = slice(1, 8)  # of `quantities`
HEADINGS = ("f", "φ sn", "φ ip", "φ po", "I sn,ip", "I sn,po", "I ip,po")
ON = shapley.coalitions(3)
GAME = np.arange(8)[None]
OFFSET = np.array([0.1, 0.0, 0.05, 0.3, 0.1, 0.0])
WRONG_BASIN_RATE = 0.03
# Standard deviations [rad x3, m x3]: of every run, of every run and setting on its own, of what a
# cause that is on adds.
SHARED = 1e-3 * np.array([0.8, 0.9, 1.0, 1.5, 2.0, 1.0])
OWN = 0.4 * SHARED
ADDED = 1e-3 * np.array(
    [
        [2.0, 1.0, 1.5, 3.0, 3.0, 1.0],
        [0.0, 0.5, 0.2, 0.5, 0.0, 1.0],
        [0.8, 0.0, 1.2, 1.0, 2.0, 0.5],
    ]
)


@dataclass(frozen=True)
class Case:
    """A way to draw the runs, and how they are read."""

    effects: bool
    common_random_numbers: bool
    wrong_basins: str  # one of WRONG_BASINS
    noise_draws: int
    interval: str = "jackknife"
    draw_effect: float = 0.5  # what a noise draw adds to all its runs, relative to each run's own
    deleted: str = "units"  # or runs, wrongly, in spite of several noise draws

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
        offsets = (
            generator.normal(size=(settings, case.noise_draws, 6)) * case.draw_effect * ADDED[0]
        )
        added[:, :, 0] += offsets[:, noise_draw]
        xi += np.einsum("sa,srai->sri", ON, np.broadcast_to(added, (len(ON), RUNS, 3, 6)))
    if case.wrong_basins != "none":
        wrong = generator.random((settings, RUNS, 1)) < WRONG_BASIN_RATE
        xi += wrong * OFFSET
    basins = find_basins(xi, LENGTH, *case.method.basin)
    return Sample(
        causes=CAUSES,
        settings=ON.astype(float),
        again=np.zeros(len(ON), dtype=bool),
        xi=xi,
        initial_xi=xi,
        failed=np.zeros((len(ON), RUNS), dtype=bool),
        no_covariance=np.zeros((len(ON), RUNS), dtype=bool),
        wrong_basin=basins.wrong,
        no_basin=basins.lacking,
        noise_draw=noise_draw if case.deleted == "units" else np.zeros_like(noise_draw),
        weight=np.ones(RUNS),
        covariance=None,
        returns=SAMPLES,
        length=LENGTH,
    )


def truth(case):
    """The quantities that infinitely many runs would give (and noise draws, if more than one)."""
    variance = np.tile(SHARED**2 + OWN**2, (len(ON), 1))
    if case.effects:
        variance += ON @ ADDED**2
        if case.noise_draws > 1:
            variance += ON[:, :1] * (case.draw_effect * ADDED[0]) ** 2
    covariance = variance[:, :, None] * np.eye(6) + readings.floor_matrix(*case.method.floor)
    if case.wrong_basins == "keep":
        covariance += WRONG_BASIN_RATE * (1 - WRONG_BASIN_RATE) * np.outer(OFFSET, OFFSET)
    game = readings.kullback_leibler(covariance[0], covariance)
    return quantities(game)[READ]


def measure(case, repetitions):
    """By quantity: the truth, the share of intervals that hold it, mean value and half width."""
    true = truth(case)
    found = []
    for repetition in range(repetitions):
        sample = draw(case, np.random.default_rng([20260101, repetition]))
        estimates = estimate(sample, GAME, quantities, case.method)
        found.append([estimates.value[0], estimates.low[0], estimates.high[0]])
    value, low, high = np.array(found)[..., READ].swapaxes(0, 1)
    columns = {
        "truth": true,
        "coverage": ((low <= true) & (true <= high)).mean(axis=0),
        "mean": value.mean(axis=0),
        "half_width": ((high - low) / 2).mean(axis=0),
    }
    return {
        name: {column: round(float(values[q]), 4) for column, values in columns.items()}
        for q, name in enumerate(QUANTITIES)
    }


def cases():
    """Every combination, then the bootstrap, then noise draws that matter much."""
    for numbers in itertools.product((True, False), (True, False), WRONG_BASINS, (1, 10)):
        yield Case(*numbers)
    for effects, noise_draws in itertools.product((True, False), (1, 10)):
        yield Case(effects, True, "none", noise_draws, interval="bootstrap")
    for draw_effect, deleted in itertools.product((1.0, 4.0), ("units", "runs")):
        yield Case(True, True, "none", 10, draw_effect=draw_effect, deleted=deleted)


def meets_requirement(case, coverages):
    """Whether the coverages are as required; None for a case of which nothing is required."""
    if case != Case(case.effects, case.common_random_numbers, case.wrong_basins, case.noise_draws):
        return None
    if not case.effects:
        return all(coverage >= 0.95 for coverage in coverages)
    if case.common_random_numbers:
        return all(0.92 <= coverage <= 0.98 for coverage in coverages)
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=1000)
    repetitions = parser.parse_args().repetitions
    start = time.process_time()
    print("| effects | random numbers | wrong basins | noise draws | interval |", end="")
    print(*(f" {heading} |" for heading in HEADINGS), " required |", sep="")
    print("|---" * (6 + len(QUANTITIES)) + "|")
    results, fulfilled = [], True
    for case in cases():
        found = measure(case, repetitions)
        coverages = [quantity["coverage"] for quantity in found.values()]
        meets = meets_requirement(case, coverages)
        fulfilled &= meets is not False
        results.append({**asdict(case), "quantities": found, "meets_requirement": meets})
        draws = f"{case.noise_draws}" + (
            f" (x {case.draw_effect:g})" if case.noise_draws > 1 else ""
        )
        cells = [
            "present" if case.effects else "none",
            "common" if case.common_random_numbers else "independent",
            case.wrong_basins.replace("_", " "),
            draws,
            case.interval + (", runs deleted" if case.deleted == "runs" else ""),
            *(f"{coverage:.3f}" for coverage in coverages),
            {True: "yes", False: "NO", None: ""}[meets],
        ]
        print("|", " | ".join(cells), "|", flush=True)
    seconds = round(time.process_time() - start, 1)
    print(
        json.dumps(
            {
                "repetitions": repetitions,
                "nominal": CONFIDENCE,
                "requirement_met": fulfilled,
                "cpu_seconds": seconds,
                "cases": results,
            }
        )
    )
    return 0 if fulfilled else 1


if __name__ == "__main__":
    sys.exit(main())
