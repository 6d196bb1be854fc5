"""What says of a degraded pair which cause matters most: a cause's name, or None for none.

Given are the degraded scans, the pose that their own registration found, the sequence's other
pairs, and what is told: the scale of the initial pose's variance and the divisor of the points.
"""

import numpy as np

from benchmarks.attribution.effects import PERTURBATION, REGISTERED_BY, mean_log_error
from icpshap import estimators, plan
from icpshap.causes import CAUSES
from icpshap.data.pair import Pair
from icpshap.diagnosis.diagnose import Known, diagnose
from icpshap.estimators.perturb import Streams
from icpshap.explanation.shapley import coalition_values, shapley_values

SEED = 5
DRAWS, RUNS = 3, 20  # of noise and of sectors; of each
# Of a game that knows nothing of the pair: levels that are worth trying.
FORWARD = {
    "sensor_noise": 0.02,
    "initial_pose": 4.0,
    "partial_overlap": 0.25,  # of what overlaps
    "under_constrained": 0.5,
    "icp_randomness": 3.0,
}


def healthy_pairs(sequence):
    """`diagnose.Known` of every clean pair of a sequence."""
    return [
        _known(sequence.clouds[k : k + 2], sequence.T(k), f"healthy {k}")
        for k in range(len(sequence.clouds) - 1)
    ]


def diagnosis(case, T_reference_source, others):
    """The `Diagnosis` of a case against the `Known` other pairs of its sequence."""
    return diagnose(_known(case.clouds(), T_reference_source, "degraded"), others)


def surest(diagnosis):
    """The cause that a diagnosis is surest of."""
    causes = diagnosis.verdict.causes
    return causes[0] if causes else None


def removed(diagnosis, case, others):
    """The cause whose removal helps most on a healthy pair with the levels that were diagnosed."""
    scale, divisor = case.told()
    levels = {**diagnosis.verdict.levels, "initial_pose": scale, "icp_randomness": divisor}
    return by_removal(others[diagnosis.healthiest].load(), levels)


def ceiling(case, clean):
    """The same with the true levels, on the true pair as it was: a `Known` one."""
    levels = {case.cause(part): level for part, level in case.parts.items()}
    pair = clean.load()
    if "partial_overlap" in levels:
        levels["partial_overlap"] *= pair.overlap
    return by_removal(pair, levels)


def forward(case, T_reference_source):
    """The paper's question of the degraded pair: what would hurt most if it got worse."""
    pair = _pair(case.clouds(), T_reference_source)
    levels = {**FORWARD, "partial_overlap": FORWARD["partial_overlap"] * pair.overlap}
    names = [cause.name for cause in CAUSES.values() if cause.name in levels]
    off = [CAUSES[name].off for name in names]
    coalitions = coalition_values(np.array([[levels[name] for name in names]]), off)[0]
    values = _log_errors(pair, [dict(zip(names, row, strict=True)) for row in coalitions])
    phi = shapley_values(np.array(values)[None])[0]
    return names[int(np.argmax(phi))]


def by_removal(pair, levels):
    """The cause whose removal lowers V of a pair most, of those that are on in `levels`."""
    levels = {name: level for name, level in levels.items() if level != CAUSES[name].off}
    if not levels:
        return None
    without = [{**levels, name: CAUSES[name].off} for name in levels]
    with_all, *others = _log_errors(pair, [levels, *without])
    drops = dict(zip(levels, with_all - np.array(others), strict=True))
    return max(drops, key=drops.get)


def _log_errors(pair, levels):
    """V of a pair at each of some levels by cause, in the mean over the draws."""
    preset = REGISTERED_BY.with_options(
        runs=DRAWS * RUNS, noise_draws=DRAWS, overlap_shape="sector"
    )
    settings = [plan.Setting.at(values) for values in levels]
    runs, _ = estimators.estimate(
        pair,
        settings,
        preset.estimator.of_causes(levels[0]),
        PERTURBATION.deviation,
        Streams(SEED, "explained", 0, 1),
    )
    names = list(levels[0])
    keys = [tuple(values[name] for name in names) for values in levels]
    length = pair.characteristic_length
    found = {
        key: np.mean([mean_log_error(of, length) for _, of in rows.groupby("noise_draw")])
        for key, rows in runs.groupby(names)
    }
    return [found[key] for key in keys]


def _pair(clouds, T_reference_source):
    pair = Pair.measured(*clouds, T_reference_source, PERTURBATION.overlap_distance)
    return pair.for_chain(REGISTERED_BY.estimator.perturbing.minimum_range)


def _known(clouds, T_reference_source, name):
    pair = _pair(clouds, T_reference_source)
    return Known(lambda: pair, Streams(SEED, name, 0, 1))
