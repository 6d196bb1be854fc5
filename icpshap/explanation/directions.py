"""Which cause makes which direction uncertain: variances, and what the squared error grows by.

The variance along a direction is a game of its own: additive where causes are independent, in
metres and radians. Directions are the axes of the reference frame at the source scanner's origin,
and the weakest one of the instance.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from icpshap.explanation import shapley
from icpshap.explanation.intervals import independent_runs
from icpshap.explanation.ranking import quantiles
from icpshap.explanation.uncertainty import (
    Estimate,
    columns_of,
    covariances,
    estimate,
    mean_of_games,
    over_replicates,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from icpshap.explanation.method import Method
    from icpshap.explanation.sample import Sample
    from icpshap.explanation.scan_pair import ScanPair


AXES = {
    "rotation_x": "roll",
    "rotation_y": "pitch",
    "rotation_z": "yaw",
    "translation_x": "along x",
    "translation_y": "along y",
    "translation_z": "along z",
}
TOTALS = {"rotation": "total rotation", "translation": "total translation"}
ERRORS = {"error_rotation": "square_rotation", "error_translation": "square_translation"}
DIRECTIONS = (*AXES, *TOTALS, "weakest", *ERRORS)
VECTOR = [f"vector_{k}" for k in range(6)]
NAMED_SHARE = 1 / 6  # of a direction, the mean of its components, from which words name one
QUANTILE = 0.95
SETTINGS_AT_ONCE = 4096


def directions_table(
    replicates: list[Sample],
    instances: pd.DataFrame,
    rows: list[np.ndarray],
    method: Method,
    pair: ScanPair,
) -> pd.DataFrame:
    """A row for each direction of each instance, and for the growth of both squared errors.

    replicates: list of `sample.Sample`; rows (i, 2^M): of each, the settings of the coalitions of
    each instance; pair: `scan_pair.ScanPair`. Variances [rad^2 or m^2] are of the runs that f is
    computed from, without the covariance floor; squared errors about the ground truth, of all that
    did not fail.
    """
    method = method.with_floor(0.0).of_covariances
    causes = list(replicates[0].causes)
    turn = pair.to_reference_axes
    unit = np.repeat([pair.characteristic_length, 1.0], 3)  # rad to m
    weakest = weakest_directions(replicates, rows, method, unit[:, None] * turn)
    vectors = {name: turn[k][None] for k, name in enumerate(AXES)}
    vectors |= {"rotation": turn[:3], "translation": turn[3:]}
    vectors["weakest"] = ((weakest * unit) @ turn)[:, None]
    parts = []
    for name in DIRECTIONS:
        if name in ERRORS:
            found = _of_errors(ERRORS[name], replicates, rows, method.of_errors)
        else:
            found = _of_variances(vectors[name], replicates, rows, method)
        part = {
            **instances[["instance", *causes]].to_dict(orient="list"),
            "direction": name,
            "words": _words(name, weakest),
            **_vector(name, weakest),
            **_columns(causes, found),
            **_quantiles(name, replicates, rows),
        }
        parts.append(pd.DataFrame(part))
    table = pd.concat(parts, ignore_index=True)
    return table.sort_values("instance", kind="stable", ignore_index=True)


def weakest_directions(
    replicates: list[Sample], rows: list[np.ndarray], method: Method, scaled: np.ndarray
) -> np.ndarray:
    """Unit vectors (i, 6) along which the covariance with all causes on is largest.

    scaled (6, 6): from pose errors to metres in the reference's axes. Of either sign that makes the
    largest component positive; NaN where too few runs are left.
    """
    covariance = covariances(replicates, rows, -1, method)
    vectors = np.full((len(covariance), 6), np.nan)
    known = np.isfinite(covariance).all(axis=(1, 2))
    if known.any():
        found = np.linalg.eigh(scaled @ covariance[known] @ scaled.T)[1][..., -1]
        largest = np.take_along_axis(found, np.abs(found).argmax(axis=1)[:, None], axis=1)
        vectors[known] = found * np.sign(largest)
    return vectors


def in_words(vector: ArrayLike) -> str:
    """A direction (6,) in words, as in 'along x, yaw': its components, the largest first.

    Rotation in units of 1/L, as `weakest_directions` gives it; small components are not named.

    >>> in_words(np.array([0, 0, 0.6, 0.8, 0, 0]))
    'along x, yaw'
    """
    shares = np.square(vector)
    named = [k for k in np.argsort(-shares, kind="stable") if shares[k] >= NAMED_SHARE]
    return ", ".join(list(AXES.values())[k] for k in named)


def _words(name, weakest):
    if name == "weakest":
        return ["" if np.isnan(vector).any() else in_words(vector) for vector in weakest]
    return {**AXES, **TOTALS}.get(name, "squared error")


def _vector(name, weakest):
    """The direction as a unit vector, where it is one."""
    vectors = np.full_like(weakest, np.nan)
    if name == "weakest":
        vectors = weakest
    elif name in AXES:
        vectors = np.broadcast_to(np.eye(6)[list(AXES).index(name)], weakest.shape)
    return dict(zip(VECTOR, vectors.T, strict=True))


def _of_errors(number, replicates, rows, method):
    """`Estimate` of the `_quantities` of a squared error, of all runs that did not fail."""
    if not replicates[0].returns.samples:
        return Estimate(*np.full((4, len(rows[0]), _width(rows)), np.nan))
    return _explained(replicates, rows, method, partial(mean_of_games, number), leave_out=False)


def _of_variances(vectors, replicates, rows, method):
    """`Estimate` of the `_quantities` of the variance along vectors."""
    return _explained(replicates, rows, method, lambda *given: partial(_variance, vectors, *given))


def _explained(replicates, rows, method, values_of, leave_out=None):
    """`Estimate` over all replicates; values_of(sample, games): `values` of `estimate`."""
    return over_replicates(
        [
            estimate(sample, games, _quantities, method, leave_out, values=values_of(sample, games))
            for sample, games in zip(replicates, rows, strict=True)
        ]
    )


def _width(rows):
    return _quantities(np.zeros(rows[0].shape[1])).shape[-1]


def _quantities(game):
    """Clean value, value, growth, and of each cause its part, removal, what remains, its share."""
    clean, value = game[..., :1], game[..., -1:]
    growth = value - clean
    phi, removal = shapley.shapley_values(game), shapley.removal_effects(game)
    share = np.divide(phi, growth, out=np.full_like(phi, np.nan), where=growth != 0)
    return np.concatenate([clean, value, growth, phi, removal, value - removal, share], axis=-1)


def _columns(causes, found):
    """Columns of `_quantities`; shares only where they may be told as per cent."""
    names = ["clean", "value", "growth"]
    names += [
        f"{what}_{cause}" for what in ("phi", "removal", "remaining", "share") for cause in causes
    ]
    columns = columns_of(names, found)
    negative = [columns[f"phi_{cause}_high"] < 0 for cause in causes]
    in_per_cent = (columns["growth_low"] > 0) & ~np.any(negative, axis=0)
    for name in columns:
        if name.startswith("share_"):
            columns[name] = np.where(in_per_cent, columns[name], np.nan)
    return columns | {"in_per_cent": in_per_cent}


def _variance(vectors, sample, games, members, weights):
    """Variance (k, g, r) along vectors, common (d, 6) or of each game (i, d, 6), summed over d."""
    if vectors.ndim == 2:
        settings, inverse = np.unique(games[members], return_inverse=True)
        found = sample.variance_along(settings, vectors, weights)
        return found[inverse.reshape(-1, games.shape[1])]
    step = max(1, SETTINGS_AT_ONCE // games.shape[1])
    parts = np.split(members, range(step, len(members), step))
    return np.concatenate(
        [sample.variance_along(games[part], vectors[part, None], weights) for part in parts]
    )


def _quantiles(name, replicates, rows):
    """95 % quantile of the error, clean and with all causes on; NaN for other rows."""
    found = Estimate(*np.full((4, len(rows[0]), 2), np.nan))
    if name in ERRORS and replicates[0].returns.samples and replicates[0].xi.size:
        found = over_replicates(
            [
                _quantiles_of(sample, np.sqrt(sample.numbers(ERRORS[name])), games[:, [0, -1]])
                for sample, games in zip(replicates, rows, strict=True)
            ]
        )
    return columns_of(["clean_quantile_95", "quantile_95"], found)


def _quantiles_of(sample, error, rows):
    """`Estimate` of the quantiles of errors (S, n) in settings `rows`."""
    value, low, high = quantiles_with_interval(error, sample.noise_draw)
    if not sample.units:
        low = high = np.full_like(value, np.nan)
    return Estimate(value[rows], low[rows], high[rows], np.full(rows.shape, np.nan))


def quantiles_with_interval(
    values: np.ndarray, noise_draw: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The 95 % quantile of values (..., n) with the ends of its interval, (...) each.

    A failed run is NaN; noise_draw (n,): the draw of each. The ends are the quantiles at the ends
    of what the share of runs below may be by chance (Woodruff, Journal of the American Statistical
    Association 47, 1952); infinite where that is all of them: so few runs bound no quantile.
    """
    known = np.isfinite(values)
    (value,) = quantiles(values[..., None], known, [QUANTILE])
    share = np.full(len(values), QUANTILE)
    number, factor = independent_runs(share, values < value, known, noise_draw)
    with np.errstate(divide="ignore"):
        half = factor * np.sqrt(share * (1 - share) / number)
    ends = [np.clip(end, 0.0, 1.0)[:, None, None] for end in (share - half, share + half)]
    low, high = quantiles(values[..., None], known, ends)[..., 0]
    high[(share + half >= 1) & np.isfinite(high)] = np.inf
    return value[..., 0], low, high
