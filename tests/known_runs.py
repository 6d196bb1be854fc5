"""Runs tables whose distribution is known: Gaussian pose errors under common random numbers."""

import itertools

import numpy as np
import pandas as pd

from icpshap.explanation import readings
from icpshap.tables import COVARIANCE, INITIAL_XI, XI

OFF = {"sensor_noise": 0.0, "initial_pose": 1.0, "partial_overlap": 0.0}
LEVELS = {"sensor_noise": [0.0, 0.05], "initial_pose": [1.0, 1.5], "partial_overlap": [0.0, 0.05]}
SHARED = 1e-3 * np.array([0.8, 0.9, 1.0, 1.5, 2.0, 1.0])
# Standard deviation that a cause adds at full level: (value - reference) / unit.
ADDED = {
    "sensor_noise": 1e-3 * np.array([2.0, 1.0, 1.5, 3.0, 3.0, 1.0]),
    "initial_pose": 1e-3 * np.array([0.0, 0.5, 0.2, 0.5, 0.0, 1.0]),
    "partial_overlap": 1e-3 * np.array([0.8, 0.0, 1.2, 1.0, 2.0, 0.5]),
}
UNIT = {"sensor_noise": 0.05, "initial_pose": 0.5, "partial_overlap": 0.05}
UPPER = np.triu_indices(6)
OFFSET = np.array([0.1, 0.0, 0.05, 0.3, 0.1, 0.0])


def instances(levels=LEVELS, full=False):
    """All combinations of the levels, or only the last of them."""
    values = list(itertools.product(*levels.values()))[slice(None) if full else slice(-1, None)]
    return pd.DataFrame(values, columns=list(levels)).rename_axis("instance").reset_index()


def pose_errors(values, draws):
    """xi (n, 6) of a setting from standard normal draws (n, 6), `shared` and one for each cause.

    A cause adds its draw times what its value is above its reference.
    """
    xi = draws["shared"] * SHARED
    for name, value in zip(OFF, values, strict=True):
        xi = xi + (value - OFF[name]) / UNIT[name] * draws[name] * ADDED[name]
    return xi


def runs_table(seed=0, levels=LEVELS, n=100, noise_draws=1, wrong=(), failed=(), replicates=1):
    """Runs of all combinations of the levels, and of the clean setting again.

    wrong: runs in a wrong basin in every setting; failed: (setting number, run) pairs.
    """
    frames = []
    for replicate in range(replicates):
        generator = np.random.default_rng([seed, replicate])
        draws = {
            again: {
                name: generator.standard_normal((n, 6)) for name in ("shared", "initial", *levels)
            }
            for again in (0, 1)
        }
        settings = [(0, values) for values in itertools.product(*levels.values())]
        settings.append((1, tuple(OFF.values())))
        for number, (again, values) in enumerate(settings):
            xi = pose_errors(values, draws[again])
            xi[list(wrong)] += OFFSET
            status = np.full(n, "ok", dtype=object)
            lost = [run for setting, run in failed if setting == number]
            status[lost], xi[lost] = "too_few_links", np.nan
            frame = pd.DataFrame(xi, columns=XI)
            frame[INITIAL_XI] = 0.1 * draws[again]["initial"]
            frames.append(
                frame.assign(
                    **dict(zip(levels, values, strict=True)),
                    replicate=replicate,
                    again=bool(again),
                    run=np.arange(n),
                    noise_draw=np.arange(n) * noise_draws // n,
                    status=status,
                    weight=1.0,
                )
            )
    return pd.concat(frames, ignore_index=True)


def covariance_of(values):
    """That of `known_runs`, for infinitely many runs."""
    on = [ADDED[name] for name, value in values.items() if value != OFF[name]]
    return np.diag(SHARED**2 + sum(added**2 for added in on))


def estimates_table(noise_draws=1, scale=lambda draw: 1.0):
    """Estimates of all combinations of LEVELS and of the clean setting again."""
    settings = [
        dict(zip(LEVELS, v, strict=True))
        for v in np.array(np.meshgrid(*LEVELS.values(), indexing="ij")).reshape(3, -1).T.tolist()
    ]
    rows = []
    for values, again in [*((v, False) for v in settings), (OFF, True)]:
        for draw in range(noise_draws):
            upper = scale(draw) * covariance_of(values)[UPPER]
            rows.append(
                {
                    **values,
                    "replicate": 0,
                    "again": again,
                    "noise_draw": draw,
                    "status": "ok",
                    "n_far": 0,
                    **dict.fromkeys(XI, 0.001 * (1 + draw)),
                    **dict(zip(COVARIANCE, upper, strict=True)),
                }
            )
    return pd.DataFrame(rows)


def true_game():
    """f of the 8 coalitions of the last combination of LEVELS, for infinitely many runs."""
    games = []
    for coalition in range(8):
        on = [name for a, name in enumerate(LEVELS) if coalition >> a & 1]
        games.append(np.diag(SHARED**2 + sum(ADDED[name] ** 2 for name in on)))
    return readings.kullback_leibler(games[0], np.array(games))
