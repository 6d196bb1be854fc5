"""How uncertain a setting is: the value f that is explained.

A reading is an entry of `READINGS`; what it may look at is a `Spread`. A sample holds n pose errors
xi = [rotation (rad); translation (m)] of one setting. Every function works on any number of leading
dimensions, and on weights as well as on whole samples: a run left out has weight 0, a run drawn
twice by a bootstrap has weight 2. So a jackknife, a bootstrap and an exclusion are one matrix
product, without the cancellation that downdating suffers when a single far-off run makes up the
covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.special import digamma

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


DIMENSION = 6
SMALLEST_ERROR = 1e-3  # m; keeps the logarithm of the error of a run that lies on the median
NULL_DRAWS = 10_000


class Moments(NamedTuple):
    """Covariance (..., 6, 6) [rad, m] and number of runs (...), all that some readings look at."""

    covariance: np.ndarray
    n: np.ndarray


@dataclass(frozen=True)
class Spread:
    """Weighted samples xi (..., n, 6) under each of r weightings (r, n); averages are (..., r).

    Weight 0 leaves a run out (a failed one, NaN, in every weighting), weight 2 counts it twice.
    floor: standard deviations [rad, m] added in squares; added (..., r, 6, 6): a covariance that
    the estimator itself gives; scatters: whether the scatter of xi counts besides; of_runs: numbers
    (..., n) of the runs by name, such as `run_numbers` gives.
    """

    xi: np.ndarray
    weights: np.ndarray
    floor: tuple[float, float]
    added: np.ndarray | float = 0.0
    scatters: bool = True
    of_runs: Mapping[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def _used(self):
        return self.weights.any(axis=0)

    @cached_property
    def n(self) -> np.ndarray:
        """Number of runs (r,)."""
        return self.weights.sum(axis=1)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance (..., r, 6, 6) with the floor [rad^2, rad m, m^2]."""
        shape = (DIMENSION, DIMENSION, *self.xi.shape[:-2], len(self.weights))
        # Entries first, so that what is computed of all matrices at once lies side by side.
        entries = np.zeros(shape)
        if self.scatters:
            weights = self.weights[:, self._used].astype(float)
            _add_scatter(entries, self.xi[..., self._used, :], weights, self.n)
        result = np.moveaxis(entries, (0, 1), (-2, -1))
        result += floor_matrix(*self.floor)
        result += self.added
        return result

    def mean(self, name: str) -> np.ndarray:
        """Weighted mean (..., r) of a number of the runs."""
        return weighted_mean(self.weights, self.of_runs[name])


def run_numbers(xi: np.ndarray, length: float) -> dict[str, np.ndarray]:
    """Numbers of runs (..., n) with pose errors xi (..., n, 6), NaN where they failed, by name.

    square_rotation [rad^2], square_translation [m^2]: squared errors about the ground truth;
    log_error: ln sqrt(L^2 |rotation|^2 + |translation|^2 + (1 mm)^2) about the component medians of
    the setting's runs that did not fail, with the pair's characteristic length L [m].
    """
    translation, rotation = pose_errors(xi)
    median = np.median(xi, axis=-2)
    failed = np.isnan(xi).any(axis=-1)
    some = failed.any(axis=-1) & ~failed.all(axis=-1)
    median[some] = np.nanmedian(xi[some], axis=-2)
    away = np.square((xi - median[..., None, :]) * np.repeat([length, 1.0], 3)).sum(axis=-1)
    return {
        "square_rotation": np.square(rotation),
        "square_translation": np.square(translation),
        "log_error": 0.5 * np.log(away + SMALLEST_ERROR**2),
    }


@dataclass(frozen=True)
class Reading:
    """One meaning of "uncertainty": `evaluate(clean, perturbed, unbiased)` of two `Spread`s.

    `unbiased` takes away what sampling alone adds on average for Gaussian samples *independent*
    of one another. compares_with_clean: f of the clean setting is 0 by identity. affine_invariant:
    f of two samples of one distribution does not depend on which; only then is there a null, of
    which `null_factor` is the mean, in units of the KL's. needs_samples: covariances alone do not
    tell; bounded: far runs do not decide it, so that none are left out; counts_failed: nor are
    those that failed; meaning: what f says, the rest of a sentence that begins with f.
    """

    label: str
    unit: str
    evaluate: Callable
    compares_with_clean: bool
    affine_invariant: bool
    null_factor: float = np.nan
    needs_samples: bool = False
    bounded: bool = False
    counts_failed: bool = False
    meaning: str = ""


def floor_matrix(rotation: float, translation: float) -> np.ndarray:
    """Covariance floor diag(rotation^2 x3, translation^2 x3); rotation [rad], translation [m]."""
    return np.diag(np.repeat([rotation**2, translation**2], 3))


def covariance(xi: ArrayLike, floor_rotation: float, floor_translation: float) -> np.ndarray:
    """Sample covariance (n - 1) plus the floor [rad, m]: (..., n, 6) to (..., 6, 6).

    >>> xi = np.random.default_rng(0).normal(scale=0.1, size=(10_000, 6))
    >>> np.diagonal(covariance(xi, 1e-6, 1e-6)).round(3).tolist()
    [0.01, 0.01, 0.01, 0.01, 0.01, 0.01]
    """
    xi = np.asarray(xi, dtype=float)
    centred = xi - xi.mean(axis=-2, keepdims=True)
    scatter = np.swapaxes(centred, -1, -2) @ centred
    return scatter / (xi.shape[-2] - 1) + floor_matrix(floor_rotation, floor_translation)


def pose_errors(xi: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
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


def weighted_sums(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Sums (..., r, q) of values (..., n, q) over n runs under weightings (r, n).

    A product of its own for each setting: to the bit, no sum depends on which others there are.
    """
    return weights @ values


def weighted_mean(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Mean (..., r) of values (..., n) under weightings (r, n); what none counts may be NaN."""
    used = weights.any(axis=0)
    sums = weighted_sums(weights[:, used], values[..., used, None])[..., 0]
    return sums / weights.sum(axis=1)


def _add_scatter(entries, xi, weights, n):
    """Put the sample covariance of xi (..., n, 6) into its entries (6, 6, ..., r)."""
    # About the median: when one far-off run is left out, the spread of the others must not be a
    # difference of large numbers.
    centred = xi - np.median(xi, axis=-2, keepdims=True)
    row, column = np.triu_indices(DIMENSION)
    products = centred[..., row] * centred[..., column]
    mean, scatter = (
        np.ascontiguousarray(np.moveaxis(weighted_sums(weights, values), -1, 0))
        for values in (centred, products)
    )
    mean /= n
    for k, (i, j) in enumerate(zip(row, column, strict=True)):
        entries[i, j] = (scatter[k] - n * mean[i] * mean[j]) / (n - 1)
        entries[j, i] = entries[i, j]


def cholesky(covariance: np.ndarray) -> np.ndarray:
    """Lower triangles (6, 6, ...) of positive definite matrices (..., 6, 6), entries first.

    Of many small matrices at once: numpy's own takes them one by one. Raises LinAlgError.
    """
    dimension = covariance.shape[-1]
    lower = np.zeros((dimension, dimension, *covariance.shape[:-2]))
    for j in range(dimension):
        pivot = covariance[..., j, j] - np.square(lower[j, :j]).sum(axis=0)
        if not (pivot > 0).all():
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        lower[j, j] = np.sqrt(pivot)
        for i in range(j + 1, dimension):
            rest = covariance[..., i, j]
            for k in range(j):
                rest = rest - lower[i, k] * lower[j, k]
            lower[i, j] = rest / lower[j, j]
    return lower


def log_determinant(covariance: np.ndarray) -> np.ndarray:
    """Natural logarithm of the determinant of positive definite matrices (..., 6, 6)."""
    lower = cholesky(covariance)
    return 2.0 * np.log(np.stack([lower[k, k] for k in range(len(lower))])).sum(axis=0)


def kullback_leibler(
    clean: np.ndarray, perturbed: np.ndarray, trace_factor: np.ndarray | float = 1.0
) -> np.ndarray:
    """KL( N(0, clean) || N(0, perturbed) ) in nats, (..., 6, 6) each to (...).

    1/2 [ tr(perturbed^-1 clean) - 6 + ln det perturbed - ln det clean ]. Raises LinAlgError if a
    matrix is not positive definite.

    >>> float(kullback_leibler(np.eye(6), 2 * np.eye(6)).round(3))
    0.579
    """
    of_clean, of_perturbed = cholesky(clean), cholesky(perturbed)
    dimension = len(of_clean)
    # Of the ratio of the two lower triangles, itself one, only squares and diagonal are needed.
    trace, logarithms = np.zeros(()), np.zeros(())
    for j in range(dimension):
        column: list[np.ndarray] = []
        for i in range(j, dimension):
            rest = of_clean[i, j]
            for k, above in enumerate(column, start=j):
                rest = rest - of_perturbed[i, k] * above
            column.append(rest / of_perturbed[i, i])
            trace = trace + np.square(column[-1])
        logarithms = logarithms + np.log(column[0])
    return 0.5 * (trace_factor * trace - dimension) - logarithms


def trace_factor(n: np.ndarray | int) -> np.ndarray | float:
    """What (...) makes tr(S_z^-1 S_clean) unbiased, S_z of n (...) Gaussian runs, not S_clean's."""
    return (n - DIMENSION - 2) / (n - 1)


def log_determinant_bias(n: np.ndarray | int, dimension: int = DIMENSION) -> np.ndarray:
    """Mean (...) of ln det S - ln det Sigma, S the sample covariance (n - 1) of n (...) runs."""
    orders = np.arange(1, dimension + 1)
    degrees = np.asarray(n, dtype=float)[..., None]
    return (digamma((degrees - orders) / 2) - np.log((degrees - 1) / 2)).sum(-1)


def floor_share(
    covariance: np.ndarray, floor_rotation: float, floor_translation: float
) -> np.ndarray:
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
    return np.sqrt(perturbed.mean("square_translation"))


def _rotation_rmse(clean, perturbed, unbiased):
    return np.sqrt(perturbed.mean("square_rotation"))


def _log_error(clean, perturbed, unbiased):
    return perturbed.mean("log_error")


def _wrong_basin_share(clean, perturbed, unbiased):
    return perturbed.mean("lost")


AWAY = "says how far the spread of the results is from that of the clean pair, 0 where it is equal"

READINGS = {
    "kl": Reading("KL(clean, perturbed)", "nats", _kl, True, True, 1.0, meaning=AWAY),
    "reverse_kl": Reading(
        "KL(perturbed, clean)", "nats", _reverse_kl, True, True, 1.0, meaning=AWAY
    ),
    "symmetric_kl": Reading("symmetric KL", "nats", _symmetric_kl, True, True, 2.0, meaning=AWAY),
    "entropy_difference": Reading(
        "entropy difference",
        "nats",
        _entropy_difference,
        True,
        True,
        0.0,
        meaning="is by how much the logarithm of the spread's volume grows",
    ),
    "translation_rmse": Reading(
        "translation RMSE",
        "m",
        _translation_rmse,
        False,
        False,
        meaning="is the root mean square of the distance to the true position",
    ),
    "rotation_rmse": Reading(
        "rotation RMSE",
        "rad",
        _rotation_rmse,
        False,
        False,
        meaning="is the root mean square of the angle to the true rotation",
    ),
    "log_error": Reading(
        "logarithm of the error about the median pose",
        "nats",
        _log_error,
        False,
        False,
        needs_samples=True,
        bounded=True,
        meaning="is the mean logarithm of the distance to the median result, which no far result "
        "decides",
    ),
    "wrong_basin_share": Reading(
        "share of runs in a wrong basin",
        "of 1",
        _wrong_basin_share,
        False,
        False,
        needs_samples=True,
        bounded=True,
        counts_failed=True,
        meaning="is how often a run fails or ends far from where most others do",
    ),
}
"""The meanings of f, by config value.

symmetric_kl is the sum of both directions (Jeffreys); log_error is V and wrong_basin_share W, whose
runs are all those that did not fail, and all.
"""


def null_mean(reading: str, n: np.ndarray | int, unbiased: bool = False) -> np.ndarray | float:
    """Mean (...) of f between two independent samples of n (...) Gaussian runs of one distribution.

    NaN for a reading that is not affine invariant.
    """
    factor = READINGS[reading].null_factor * (not unbiased)
    return factor * DIMENSION * (DIMENSION + 1) / (2 * (n - DIMENSION - 2))


@cache
def null_quantile(reading: str, n: int, probability: float, unbiased: bool = False) -> float:
    """Simulated quantile of f between two independent samples of n runs of one distribution.

    NaN for a reading that is not affine invariant, which has no null.
    """
    if not READINGS[reading].affine_invariant:
        return np.nan
    return np.quantile(_null_values(reading, n, unbiased), probability)


@cache
def _null_values(reading, n, unbiased):
    from scipy.stats import wishart  # a third of a second, which reading options need not wait for

    generator = np.random.default_rng(n)
    samples = wishart.rvs(n - 1, np.eye(DIMENSION), (2, NULL_DRAWS), generator) / (n - 1)
    clean, perturbed = (Moments(sample, np.array(float(n))) for sample in samples)
    return READINGS[reading].evaluate(clean, perturbed, unbiased)
