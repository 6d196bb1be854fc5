"""How far two samples of pose errors lie apart: the value f that is explained.

A reading is an entry of `READINGS`; what it may look at is a `Spread`. A sample holds n pose errors
xi = [rotation (rad); translation (m)] of one setting. Every function works on any number of leading
dimensions, and on weights as well as on whole samples: a run left out has weight 0, a run drawn
twice by a bootstrap has weight 2. So a jackknife, a bootstrap and an exclusion are one matrix
product, without the cancellation that downdating suffers when a single far-off run makes up the
covariance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.special import digamma

DIMENSION = 6
GOOD_STATUS = ("ok", "max_iterations")  # of the runs that enter covariances
NULL_DRAWS = 10_000


@dataclass(frozen=True)
class Spread:
    """Second moments of weighted samples, leading dimensions (...).

    covariance (..., 6, 6) with the floor added [rad^2, rad m, m^2]; n (...) number of runs; mean
    squares (...) of the pose error about the ground truth (not about the sample's mean), rotation
    [rad^2] and translation [m^2].
    """

    covariance: np.ndarray
    n: np.ndarray
    mean_square_rotation: np.ndarray
    mean_square_translation: np.ndarray


@dataclass(frozen=True)
class Reading:
    """One meaning of "uncertainty": `evaluate(clean, perturbed, unbiased)` of two `Spread`s.

    `unbiased` takes away what sampling alone adds on average for Gaussian samples *independent*
    of one another. compares_with_clean: f of the clean setting is 0 by identity. affine_invariant:
    f of two samples of one distribution does not depend on which; only then is there a null, of
    which `null_factor` is the mean, in units of the KL's.
    """

    label: str
    unit: str
    evaluate: Callable
    compares_with_clean: bool
    affine_invariant: bool
    null_factor: float = np.nan


def floor_matrix(rotation, translation):
    """Covariance floor diag(rotation^2 x3, translation^2 x3); rotation [rad], translation [m]."""
    return np.diag(np.repeat([rotation**2, translation**2], 3))


def covariance(xi, floor_rotation, floor_translation):
    """Sample covariance (n - 1) plus the floor [rad, m]: (..., n, 6) to (..., 6, 6)."""
    xi = np.asarray(xi, dtype=float)
    centred = xi - xi.mean(axis=-2, keepdims=True)
    scatter = np.swapaxes(centred, -1, -2) @ centred
    return scatter / (xi.shape[-2] - 1) + floor_matrix(floor_rotation, floor_translation)


def pose_errors(xi):
    """Translation [m] and rotation [rad] of the poses exp(xi), (..., 6) to (...) each."""
    xi = np.asarray(xi, dtype=float)
    rotation, rho = xi[..., :3], xi[..., 3:]
    angle = np.linalg.norm(rotation, axis=-1)
    square = np.square(rho).sum(-1)
    # exp bends rho: what is orthogonal to the axis shrinks by the chord of half the angle.
    axis = rotation / np.where(angle > 0, angle, 1.0)[..., None]
    orthogonal = square - np.square((axis * rho).sum(-1))
    shrink = 1.0 - np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.sqrt(np.maximum(square - shrink * orthogonal, 0.0)), angle


def spread(xi, weights, floor_rotation, floor_translation, added=0.0, scatters=True):
    """`Spread` (..., r) of samples xi (..., n, 6) under each of r weightings (r, n) of their runs.

    Weight 0 leaves a run out (a failed one, NaN, in every weighting), weight 2 counts it twice.
    added (..., r, 6, 6): a covariance that the estimator itself gives; scatters: whether the
    scatter of xi counts besides.
    """
    used = weights.any(axis=0)
    xi, weights = xi[..., used, :], weights[:, used].astype(float)
    n = weights.sum(axis=1)
    result = np.zeros((*xi.shape[:-2], len(weights), DIMENSION, DIMENSION))
    if scatters:
        _add_scatter(result, xi, weights, n)
    result += floor_matrix(floor_rotation, floor_translation)
    result += added
    translation, rotation = pose_errors(xi)
    squares = [np.square(error) @ weights.T / n for error in (rotation, translation)]
    return Spread(result, n, *squares)


def _add_scatter(covariance, xi, weights, n):
    """Put the sample covariance of xi (..., n, 6) into (..., r, 6, 6)."""
    # About the median: when one far-off run is left out, the spread of the others must not be a
    # difference of large numbers.
    centred = xi - np.median(xi, axis=-2, keepdims=True)
    mean = weights @ centred / n[:, None]
    row, column = np.triu_indices(DIMENSION)
    scatter = weights @ (centred[..., row] * centred[..., column])
    scatter -= n[:, None] * mean[..., row] * mean[..., column]
    covariance[..., row, column] = covariance[..., column, row] = scatter / (n - 1)[:, None]


def log_determinant(covariance):
    """Natural logarithm of the determinant of positive definite matrices (..., 6, 6)."""
    return 2.0 * np.log(np.diagonal(np.linalg.cholesky(covariance), axis1=-2, axis2=-1)).sum(-1)


def kullback_leibler(clean, perturbed, trace_factor=1.0):
    """KL( N(0, clean) || N(0, perturbed) ) in nats, (..., 6, 6) each to (...).

    1/2 [ tr(perturbed^-1 clean) - 6 + ln det perturbed - ln det clean ]. Raises LinAlgError if a
    matrix is not positive definite.
    """
    clean_factor, perturbed_factor = np.linalg.cholesky(clean), np.linalg.cholesky(perturbed)
    ratio = np.linalg.solve(perturbed_factor, clean_factor)
    # The ratio of two lower triangles is one: its diagonal carries the determinants.
    logarithms = np.log(np.diagonal(ratio, axis1=-2, axis2=-1)).sum(-1)
    dimension = clean.shape[-1]
    return 0.5 * (trace_factor * np.square(ratio).sum((-1, -2)) - dimension) - logarithms


def trace_factor(n, dimension=DIMENSION):
    """What makes tr(S_z^-1 S_clean) unbiased, S_z of n Gaussian runs independent of S_clean's."""
    return (n - dimension - 2) / (n - 1)


def log_determinant_bias(n, dimension=DIMENSION):
    """Mean of ln det S - ln det Sigma for the sample covariance S (n - 1) of n Gaussian runs."""
    orders = np.arange(1, dimension + 1)
    degrees = np.asarray(n, dtype=float)[..., None]
    return (digamma((degrees - orders) / 2) - np.log((degrees - 1) / 2)).sum(-1)


def floor_share(covariance, floor_rotation, floor_translation):
    """Largest share, over directions, of the floor in the variance; (..., 6, 6) to (...)."""
    deviation = np.repeat([floor_rotation, floor_translation], 3)
    factor = np.linalg.solve(np.linalg.cholesky(covariance), np.diag(deviation))
    return np.linalg.norm(factor, ord=2, axis=(-2, -1)) ** 2


def _kl(clean, perturbed, unbiased):
    if not unbiased:
        return kullback_leibler(clean.covariance, perturbed.covariance)
    bias = log_determinant_bias(perturbed.n) - log_determinant_bias(clean.n)
    value = kullback_leibler(clean.covariance, perturbed.covariance, trace_factor(perturbed.n))
    return value - 0.5 * bias


def _reverse_kl(clean, perturbed, unbiased):
    return _kl(perturbed, clean, unbiased)


def _symmetric_kl(clean, perturbed, unbiased):
    return _kl(clean, perturbed, unbiased) + _kl(perturbed, clean, unbiased)


def _entropy_difference(clean, perturbed, unbiased):
    value = log_determinant(perturbed.covariance) - log_determinant(clean.covariance)
    if unbiased:
        value = value - log_determinant_bias(perturbed.n) + log_determinant_bias(clean.n)
    return 0.5 * value


def _translation_rmse(clean, perturbed, unbiased):
    return np.sqrt(perturbed.mean_square_translation)


def _rotation_rmse(clean, perturbed, unbiased):
    return np.sqrt(perturbed.mean_square_rotation)


READINGS = {
    "kl": Reading("KL(clean, perturbed)", "nats", _kl, True, True, 1.0),
    "reverse_kl": Reading("KL(perturbed, clean)", "nats", _reverse_kl, True, True, 1.0),
    "symmetric_kl": Reading("symmetric KL", "nats", _symmetric_kl, True, True, 2.0),
    "entropy_difference": Reading(
        "entropy difference", "nats", _entropy_difference, True, True, 0.0
    ),
    "translation_rmse": Reading("translation RMSE", "m", _translation_rmse, False, False),
    "rotation_rmse": Reading("rotation RMSE", "rad", _rotation_rmse, False, False),
}
"""The meanings of f, by config value; symmetric_kl is the sum of both directions (Jeffreys)."""


def null_mean(reading, n, unbiased=False):
    """Mean of f between two independent samples of n Gaussian runs of the same distribution.

    NaN for a reading that is not affine invariant.
    """
    factor = READINGS[reading].null_factor * (not unbiased)
    return factor * DIMENSION * (DIMENSION + 1) / (2 * (n - DIMENSION - 2))


@cache
def null_quantile(reading, n, probability, unbiased=False):
    """Simulated quantile of f between two independent samples of n runs of one distribution.

    NaN for a reading that is not affine invariant, which has no null.
    """
    if not READINGS[reading].affine_invariant:
        return np.nan
    return np.quantile(_null_values(reading, n, unbiased), probability)


@cache
def _null_values(reading, n, unbiased):
    from scipy.stats import (
        wishart,
    )  # a third of a second, which the configuration need not wait for

    generator = np.random.default_rng(n)
    samples = wishart.rvs(n - 1, np.eye(DIMENSION), (2, NULL_DRAWS), generator) / (n - 1)
    clean, perturbed = (Spread(sample, np.float64(n), None, None) for sample in samples)
    return READINGS[reading].evaluate(clean, perturbed, unbiased)
