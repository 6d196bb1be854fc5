"""What f would be if the sensor's own noise were another: a reading, without another run.

To first order a covariance that is told the noise grows with its square. Where the noise was drawn
it is the scatter of the noise draws, beyond what their runs alone scatter, that grows so.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import eigh

if TYPE_CHECKING:
    from icpshap.explanation.sample import Sample


SENSOR_NOISE = "sensor_noise"


def with_sensor_sigma(sample: Sample, times: float) -> Sample | None:
    """The `Sample` with `times` the sensor's own noise; None if its spread does not hold that.

    All runs of a setting count as failed where its draws cannot be told from their runs.
    """
    returns = sample.returns
    if not returns.sensor_sigma:
        return None
    level = np.zeros(len(sample.settings))
    if SENSOR_NOISE in sample.causes and returns.together:
        level = sample.settings[:, sample.causes.index(SENSOR_NOISE)]
    own = np.square(returns.sensor_sigma)
    factor = (times**2 * own + level**2) / (own + level**2)
    if not returns.drawn:
        return replace(sample, covariance=factor[:, None, None, None] * sample.covariance)
    moved = [
        _moved(xi, ~lost, sample.noise_draw, grows)
        for xi, lost, grows in zip(sample.xi, sample.lost, factor, strict=True)
    ]
    unknown = np.isnan(moved).any(axis=-1)
    return replace(sample, xi=np.array(moved), failed=sample.failed | unknown)


def _moved(xi, good, noise_draw, factor):
    """Pose errors (n, 6) whose noise draws scatter as if the variance of their noise had grown.

    good (n,): runs from which the scatter is estimated; all move with their draw. With the
    covariance W of the runs of a draw about its mean, the means of m runs scatter by B + W / m;
    they are moved so that they do by factor B + W / m, direction by direction.
    """
    draws, number = np.unique(noise_draw, return_inverse=True)
    counts = np.bincount(number[good], minlength=len(draws))
    if (counts < 2).any():
        return np.full_like(xi, np.nan)
    means = np.array([xi[good & (number == k)].mean(axis=0) for k in range(len(draws))])
    within = xi[good] - means[number[good]]
    of_runs = within.T @ within / (good.sum() - len(draws)) * np.mean(1 / counts)
    between = np.cov(means.T)
    try:
        variance, vectors = eigh(between, of_runs)
    except np.linalg.LinAlgError:
        return np.full_like(xi, np.nan)
    wanted = factor * np.maximum(variance - 1, 0) + np.minimum(variance, 1)
    scale = np.sqrt(np.divide(wanted, variance, out=np.ones(len(variance)), where=variance > 0))
    # vectors^T of_runs vectors = I, so that vectors^-1 = vectors^T of_runs.
    along = (means - means.mean(axis=0)) @ vectors * (scale - 1)
    return xi + (along @ (of_runs @ vectors).T)[number]
