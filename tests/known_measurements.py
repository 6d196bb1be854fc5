"""Measurements of a short drive, as a covariances table and one by one."""

import numpy as np
import pandas as pd

from icpshap import se3
from icpshap.export.measurement import measurements
from icpshap.tables import TRANSFORM, covariance_columns

OFF = {"sensor_noise": 0.0, "initial_pose": 1.0}
ON = {"sensor_noise": 0.02, "initial_pose": 1.5}
DEVIATIONS = np.array([2.0, 1.0, 4.0, 30.0, 10.0, 20.0]) * 1e-4
POSES = [
    se3.exp(np.array([0.1, -0.2, 0.4 + 0.3 * pair, 1.0 + pair, 0.5, -0.3])) for pair in range(3)
]


def covariance(pair, factor=1.0):
    """A covariance (6, 6) [rad, m] that is not diagonal, another for each pair."""
    generator = np.random.default_rng(pair)
    mixed = np.eye(6) + 0.3 * generator.standard_normal((6, 6))
    root = DEVIATIONS[:, None] * mixed
    return factor * root @ root.T


def table(levels=((0.0, 0.02), (1.0, 1.5)), sequences=("drive",), replicates=1, number=3):
    """A covariances table; each cause that is on doubles the covariance."""
    rows = []
    for sequence in sequences:
        for pair, T in enumerate(POSES[:number]):
            for replicate in range(replicates):
                for noise, start in [(a, b) for a in levels[0] for b in levels[1]]:
                    factor = 2.0 ** ((noise > 0) + (start > 1)) * (1 + replicate)
                    rows.append(
                        {
                            "sequence": sequence,
                            "reference": pair,
                            "source": pair + 1,
                            "replicate": replicate,
                            "sensor_noise": noise,
                            "initial_pose": start,
                            "again": False,
                            "n_runs": 100,
                            "n_used": 98,
                            **dict(zip(TRANSFORM, T.ravel(), strict=True)),
                            **covariance_columns(covariance(pair, factor)),
                            "reason": "",
                        }
                    )
    rows.append({**rows[0], "again": True})
    return pd.DataFrame(rows)


def drive(levels=ON):
    """The measurements of the drive in one setting."""
    return [one for one in measurements(table()) if one.levels == levels]
