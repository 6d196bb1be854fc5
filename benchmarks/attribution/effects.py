"""What each part of a degraded pair does to its registration: the labels of the benchmark.

V, the mean logarithm of a run's error about the median pose of all runs, is measured on the
injector's own draws, with and without each part.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from icpshap import estimators
from icpshap.data.pair import Pair
from icpshap.estimators.kind import GOOD_STATUS
from icpshap.estimators.perturb import Perturbation, Streams
from icpshap.plan import Setting
from icpshap.presets import LIDAR
from icpshap.tables import TRANSFORM, XI

EFFECT = 0.15  # of V by the removal of a part, below which a case has none
SMALLEST = 1e-3  # m, added in squares to an error
PERTURBATION = Perturbation()
# One draw of all: that of the injector.
REGISTERED_BY = LIDAR.with_options(
    runs=60, noise_draws=1, sensor_sigma=0.0, bias_correction="none", voxel_size=0.15
)


class Effects(NamedTuple):
    """V of a case with all its parts, and what it falls by without each.

    T_reference_source (4, 4): where its first run ended, which is what is known of the pose.
    """

    value: float
    drops: dict
    T_reference_source: np.ndarray

    @property
    def first(self):
        """The part whose removal lowers V most; None where none has an effect."""
        best = max(self.drops, key=self.drops.get)
        return best if self.drops[best] > EFFECT else None

    @property
    def margin(self):
        """By how much it is ahead of the next."""
        ranked = sorted(self.drops.values(), reverse=True)
        return ranked[0] - ranked[1] if len(ranked) > 1 else np.inf


def effects(case):
    length = _length(case)
    runs = _runs(case)
    value = mean_log_error(runs, length)
    drops = {part: value - _without(case, part, length) for part in case.parts}
    first = runs[runs.status.isin(GOOD_STATUS)].iloc[0]
    return Effects(value, drops, first[TRANSFORM].to_numpy(dtype=float).reshape(4, 4))


def _without(case, part, length):
    """V of a case without a part; of one part that of the clean pair, which is measured once."""
    if len(case.parts) > 1:
        return mean_log_error(_runs(case, part), length)
    of = case.sequence
    key = (of.scene, of.scanner, case.pair, case.seed)
    if key not in _CLEAN:
        _CLEAN[key] = mean_log_error(_runs(case, part), length)
    return _CLEAN[key]


_CLEAN = {}  # V by scene, scanner, pair and seed


def _runs(case, without=None):
    """The runs table of a case; `without` one of its parts."""
    pair = Pair.measured(
        *case.clouds(without), case.sequence.T(case.pair), PERTURBATION.overlap_distance
    )
    scale, divisor = case.told(without)
    levels = {"initial_pose": scale, "icp_randomness": divisor}
    runs, _ = estimators.estimate(
        pair,
        [Setting.at(levels)],
        REGISTERED_BY.estimator.of_causes(levels),
        PERTURBATION.deviation,
        Streams(case.seed, f"effects {case.sequence.scene}", case.pair, case.pair + 1),
    )
    return runs


def mean_log_error(runs, length):
    """V of the rows of a runs table; length [m]: at which a rotation counts."""
    xi = runs.loc[runs.status.isin(GOOD_STATUS), XI].to_numpy()
    apart = xi - np.median(xi, axis=0)
    square = length**2 * np.square(apart[:, :3]).sum(axis=1) + np.square(apart[:, 3:]).sum(axis=1)
    return float(np.mean(np.log(np.sqrt(square + SMALLEST**2))))


def _length(case):
    """That of the clean pair, the same with and without a part."""
    reference, source = case.sequence.clouds[case.pair : case.pair + 2]
    clean = Pair.measured(
        reference, source, case.sequence.T(case.pair), PERTURBATION.overlap_distance
    )
    clean = replace(clean, minimum_range=REGISTERED_BY.estimator.perturbing.minimum_range)
    return clean.characteristic_length
