"""What makes a number doubtful: the null, the A/A value, the floor's share, memory, and remarks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from icpshap.explanation import readings
from icpshap.explanation.patterns import alike
from icpshap.explanation.sample import FEWEST_RUNS
from icpshap.explanation.uncertainty import estimate, kept_runs, perturbed

if TYPE_CHECKING:
    from icpshap.explanation.method import Method
    from icpshap.explanation.sample import Sample


AGAIN_PROBABILITY = 0.99
LARGE_SHARE = 0.5  # of the clean variance, from which floor or memory are named


def clean_again(sample: Sample, method: Method) -> float:
    """The A/A value: f between the clean setting and its repetition.

    NaN if that was not run, and for samples that are not independent of one another.
    """
    again = np.flatnonzero(sample.again)
    if len(again) == 0 or not sample.returns.exchangeable:
        return np.nan
    game = np.array([[sample.rows(sample.settings[again[0]]), again[0]]])
    return estimate(sample, game, perturbed, method, intervals=False).value[0, 0]


def independent(n_used: np.ndarray, sample: Sample, games: np.ndarray) -> np.ndarray:
    """How many independent samples (i,) the settings of games (i, g) have, at least."""
    if sample.returns.chain:
        return np.nan_to_num(sample.effective[games].min(axis=1)).astype(int)
    return n_used


def null(n_used: np.ndarray, sample: Sample, method: Method) -> np.ndarray:
    """Mean and 95 % quantile of f where nothing is perturbed, for independent runs: (...) each.

    n_used: of `independent`. 0 for a deterministic estimator, whose f is exactly that; NaN where
    there is no null: runs whose draws share the sensor's own noise are not independent.
    """
    if sample.returns.is_deterministic and method.reading.compares_with_clean:
        return np.zeros((2, *np.shape(n_used)))
    numbers, inverse = np.unique(n_used, return_inverse=True)
    found = np.full((2, len(numbers)), np.nan)
    if (sample.returns.exchangeable and not sample.returns.drawn) or sample.returns.chain:
        for column in np.flatnonzero(numbers >= FEWEST_RUNS):
            n = int(numbers[column])
            corrected = method.bias_correction != "none"
            found[0, column] = readings.null_mean(method.divergence, n, corrected)
            found[1, column] = null_quantile(method, n, 0.95)
    return found[:, inverse]


def null_quantile(method: Method, n: int, probability: float) -> float:
    """Quantile of f where nothing is perturbed, for n independent Gaussian runs."""
    corrected = method.bias_correction != "none"
    return readings.null_quantile(method.divergence, int(n), probability, corrected)


def degeneracy(sample: Sample, games: np.ndarray, method: Method) -> dict[str, np.ndarray]:
    """How far the covariance of the last setting of each game (i, g) can be trusted, by column.

    logdet, condition and smallest_standard_deviation of the covariance with its floor, rad and m
    counted alike; floor_share: the floor's largest share in the variance of a direction; memory:
    the largest share of a pose component's variance that follows the initial pose.
    """
    method = method.of_covariances
    names = ("logdet", "condition", "smallest_standard_deviation", "floor_share", "memory")
    columns = {name: np.full(len(games), np.nan) for name in names}
    for kept, members in alike(kept_runs(sample, games, method)):
        if kept.sum() < sample.fewest:
            continue
        rows = games[members, -1]
        covariance = sample.spread(rows, kept[None].astype(float), method).covariance[:, 0]
        variances = np.linalg.eigvalsh(covariance)
        columns["logdet"][members] = readings.log_determinant(covariance)
        columns["condition"][members] = variances[:, -1] / variances[:, 0]
        columns["smallest_standard_deviation"][members] = np.sqrt(variances[:, 0])
        columns["floor_share"][members] = readings.floor_share(covariance, *method.floor)
        if sample.returns.exchangeable:
            for right, others in alike(kept & ~sample.wrong_basin[rows]):
                runs = np.ix_(rows[others], np.flatnonzero(right))
                columns["memory"][members[others]] = memory(
                    sample.initial_xi[runs], sample.xi[runs]
                )
    return columns


def memory(initial_xi: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Largest share of a component's variance in xi (..., n, 6) that is linear in initial_xi.

    The adjusted R^2, (...): about 0 where ICP converged, for then it has forgotten where it
    started. NaN for fewer than two runs a parameter.
    """
    n, parameters = xi.shape[-2], initial_xi.shape[-1] + 1
    if n < 2 * parameters:
        return np.full(xi.shape[:-2], np.nan)
    design = np.concatenate([np.ones((*xi.shape[:-1], 1)), initial_xi], axis=-1)
    basis, size, _ = np.linalg.svd(design, full_matrices=False)
    # Columns that depend on others, such as a component that is never perturbed, add no direction.
    basis = basis * (size > size[..., :1] * n * np.finfo(float).eps)[..., None, :]
    residual = xi - basis @ (np.swapaxes(basis, -1, -2) @ xi)
    unexplained = np.square(residual).sum(axis=-2) / (n - parameters)
    variance = xi.var(axis=-2, ddof=1)
    share = 1.0 - np.divide(unexplained, variance, out=np.ones_like(variance), where=variance > 0)
    return np.maximum(0.0, share.max(axis=-1))


def remarks(
    sample: Sample, method: Method, n_used: int, clean_floor_share: float, clean_memory: float
) -> str:
    """What makes f or phi doubtful, in words; empty if nothing does."""
    found = []
    if method.reading.needs_samples and not sample.returns.samples:
        found.append(
            f"the {method.reading.label} needs pose samples, which the estimator does not return: "
            "no value"
        )
    elif n_used < sample.fewest:
        runs = "runs" if sample.returns.samples else "noise draws"
        lack = " (their covariance failed, or is that of another basin)"
        lack *= bool(sample.no_covariance.any())
        found.append(f"only {n_used} {runs} left{lack}, fewer than {sample.fewest}: no value")
    if clean_floor_share > LARGE_SHARE:
        found.append(
            f"the floor makes up {clean_floor_share:.0%} of the clean variance in one direction"
        )
    if clean_memory > LARGE_SHARE:
        found.append(
            f"the initial pose explains {clean_memory:.0%} of the clean variance of a component: "
            "it shows where the iteration stops"
        )
    return "; ".join(found)


def remarks_of_games(
    replicates: list[Sample],
    rows: list[np.ndarray],
    n_used: np.ndarray,
    n_right_basin: np.ndarray,
    f_again: float,
    method: Method,
) -> list[str]:
    """A text for each of the games rows (i, g): `remarks`, and what basins and A/A value tell.

    replicates: list of `Sample`, rows: of each; n_used, n_right_basin (i,): runs left, and those
    left without wrong basins; f_again: the A/A value.
    """
    clean = [
        degeneracy(sample, row[:1, :1], method)
        for sample, row in zip(replicates, rows, strict=True)
    ]
    floor_share, memory = (max(part[key][0] for part in clean) for key in ("floor_share", "memory"))
    first = replicates[0]
    texts = []
    for n, right, far in zip(n_used, n_right_basin, most_far(replicates, rows), strict=True):
        found = [remarks(first, method, n, floor_share, memory)]
        if far:
            found.append(
                f"up to {far} of 12 sigma points of a setting end in another basin, and each "
                "weighs 1/12 of the covariance of its draw"
            )
        if first.returns.is_deterministic and n == 1 < first.xi.shape[1]:
            found.append("one noise draw is left: no interval, and no correction of the bias")
        if right < first.fewest <= n:
            found.append(
                f"fewer than {first.fewest} runs are never in a wrong basin: no value without those"
            )
        known = np.isfinite(f_again) and n >= first.fewest and not first.returns.drawn
        if known and f_again > null_quantile(method, n, AGAIN_PROBABILITY):
            found.append(
                f"two clean samples differ by {f_again:.2g}, more than Gaussian ones would: a few "
                "runs make up the covariance"
            )
        texts.append("; ".join(filter(None, found)))
    return texts


def most_far(replicates: list[Sample], rows: list[np.ndarray]) -> np.ndarray:
    """Sigma points (i,) in another basin, in that setting and draw of a game (i, g) with most."""
    far = [np.broadcast_to(sample.far, len(sample.settings)) for sample in replicates]
    return np.max([of[row].max(axis=1) for of, row in zip(far, rows, strict=True)], axis=0)


def no_interval(replicates: list[Sample]) -> str:
    """Why numbers of these samples have no interval; "" if they have one."""
    first = replicates[0]
    if len(replicates) > 1 or first.units or not first.xi.shape[1]:
        return ""
    if first.returns.is_deterministic:
        return "the estimator is deterministic, and there is one noise draw: nothing varies"
    return "the estimator's samples depend on one another, and there is one noise draw"
