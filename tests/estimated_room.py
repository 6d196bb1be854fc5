"""Estimates of covariances of a pair, as tests read them; and a cloud that is too flat for one."""

import numpy as np

from icpshap import estimators, options
from icpshap.estimators import KINDS, Estimator
from icpshap.estimators.perturb import Perturbation, Streams
from icpshap.plan import Setting
from icpshap.tables import COVARIANCE

NAMES = ("sensor_noise", "initial_pose", "partial_overlap")
STREAMS = Streams(1, "room", 0, 1)
DEVIATION = Perturbation().deviation


def estimator(kind="closed_form", **values):
    """All source points and, where a kind has the option, normals that noise does not turn."""
    given = {"subsampling_probability": 1.0, **values}
    if "normal_neighbours" in options.names(KINDS[kind]):
        given.setdefault("normal_neighbours", 12)
    return Estimator.of(kind, given).of_causes(NAMES)


def setting(*levels):
    """The setting at a level of sensor noise, initial pose and overlap."""
    return Setting.at(dict(zip(NAMES, levels, strict=True)))


def estimate(pair, levels, kind="closed_form", **values):
    """The table of estimates of a kind with some options, a row for each of the levels."""
    settings = [setting(*row) for row in levels]
    given = (settings, estimator(kind, **values), DEVIATION, STREAMS)
    return estimators.estimate(pair, *given)[1]


def covariances(table):
    """The covariances (s, 6, 6) of a table of estimates."""
    result = np.zeros((len(table), 6, 6))
    row, column = np.triu_indices(6)
    result[:, row, column] = result[:, column, row] = table[COVARIANCE]
    return result


def flat(count, seed):
    """Points (count, 3) on a level plane."""
    points = np.random.default_rng(seed).uniform(1, 5, (count, 3))
    points[:, 2] = 2.0
    return points
