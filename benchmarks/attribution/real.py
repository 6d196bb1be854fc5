"""Cases of the real pairs, each beside itself as it was: printed, and not counted.

There is no other pair of their sequences: what is healthy is the clean pair, as no robot has it.
"""

import numpy as np

from benchmarks.attribution import injector
from benchmarks.real_pairs import PATHS, folder, real_pair

SHARES = (0.25, 0.75)  # of a mechanism's range, on a logarithmic scale
FIRST_NUMBER = 300_000  # from which random numbers come, behind those of all other cases


def real_cases(seed):
    """Each measured mechanism at two levels on each real pair; none without ICPSHAP_REAL_DATA."""
    cases = []
    for name in PATHS if folder() else ():
        pair = real_pair(name)
        poses = np.stack([np.eye(4), pair.T_reference_source])
        scanner = {"apartment": "tilting", "spinning": "spinning"}[name]
        # A point at the origin is no return, and has no beam.
        clouds = [cloud[cloud.any(axis=1)] for cloud in (pair.reference, pair.source)]
        sequence = injector.Sequence(f"real {name}", scanner, clouds, poses)
        for mechanism in (*injector.MEASURED, *injector.UNKNOWN):
            for share in SHARES:
                parts = {mechanism: _level(mechanism, share)}
                number = FIRST_NUMBER + len(cases)
                cases.append(injector.Case(sequence, 0, parts, number, seed))
    return cases


def _level(mechanism, share):
    cause = injector.UNKNOWN.get(mechanism, mechanism)
    low, high = np.log(injector.RANGES[cause])
    value = float(np.exp(low + share * (high - low)))
    return value if cause == "sensor_noise" else 1.0 - value
