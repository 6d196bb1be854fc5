"""From the runs of a pair to f, the uncertainty of each setting, with intervals and warnings.

A *game* is a list of settings, the clean one first, whose f belong together: the coalitions of an
instance, or clean and perturbed. Runs left out of one of its settings are left out of all.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from icpshap.errors import UserError
from icpshap.explanation import readings as divergence
from icpshap.explanation.intervals import Resampling
from icpshap.tables import INITIAL_XI, XI

MINIMUM_RUNS = 50
BOOTSTRAP_DRAWS = 1000
SUCCESS_TRANSLATION = 0.1
SUCCESS_ROTATION = np.deg2rad(2.0)
SETTINGS_AT_ONCE = 64


@dataclass(frozen=True)
class Method:
    """How runs become numbers: keys of an estimator in the configuration, under the same names.

    covariance_floor_rotation [rad], covariance_floor_translation [m]; divergence: a key of
    `divergence.READINGS`; wrong_basins: keep or leave_out; bias_correction: none, jackknife or
    wishart; interval: jackknife or bootstrap; seed: of the bootstrap.
    """

    covariance_floor_rotation: float = 1e-6
    covariance_floor_translation: float = 1e-6
    divergence: str = "kl"
    wrong_basins: str = "keep"
    bias_correction: str = "none"
    interval: str = "jackknife"
    seed: int = 0

    @property
    def reading(self):
        return divergence.READINGS[self.divergence]

    @property
    def floor(self):
        return self.covariance_floor_rotation, self.covariance_floor_translation

    @property
    def leaves_out_wrong_basins(self):
        return self.wrong_basins == "leave_out"

    def with_floor(self, factor):
        """The same with `factor` times the covariance floor (as a standard deviation)."""
        rotation, translation = (factor * floor for floor in self.floor)
        return replace(
            self, covariance_floor_rotation=rotation, covariance_floor_translation=translation
        )


@dataclass(frozen=True)
class Sample:
    """The runs of one pair and one seed: S settings with the same n runs in each.

    sources (M) names; settings (S, M) their values; draws (S,) 0, or 1 for the clean setting run
    again with random draws of its own; xi and initial_xi (S, n, 6) errors of final and initial
    pose, rotation [rad] first; failed, wrong_basin (S, n); noise_draw (n,) which one a run used.
    """

    sources: tuple
    settings: np.ndarray
    draws: np.ndarray
    xi: np.ndarray
    initial_xi: np.ndarray
    failed: np.ndarray
    wrong_basin: np.ndarray
    noise_draw: np.ndarray

    @classmethod
    def without_runs(cls, sources, settings):
        """The sample of a pair that was not registered."""
        marks = np.zeros((len(settings), 0), dtype=bool)
        xi = np.zeros((*marks.shape, 6))
        none = np.zeros(0, dtype=int)
        draws = np.zeros(len(settings), dtype=int)
        return cls(tuple(sources), settings, draws, xi, xi, marks, marks, none)

    def rows(self, values, draws=0):
        """Row of each setting in values (..., M). Raises UserError if one was not run."""
        values = np.asarray(values, dtype=float)
        flat = values.reshape(-1, values.shape[-1])
        known = pd.MultiIndex.from_arrays([*self.settings.T, self.draws])
        wanted = pd.MultiIndex.from_arrays([*flat.T, np.full(len(flat), draws)])
        rows = known.get_indexer(wanted)
        if (rows < 0).any():
            missing = np.unique(flat[rows < 0], axis=0)
            first = ", ".join(f"{s} {v:g}" for s, v in zip(self.sources, missing[0], strict=True))
            raise UserError(
                f"{len(missing)} settings have no runs, the first is {first}; "
                f"{len(self.settings)} settings have.\n"
                "Hint: the runs belong to another configuration; run the registrations again."
            )
        return rows.reshape(values.shape[:-1])


def samples(runs, sources):
    """One `Sample` per replicate of a pair's runs table; sources: the names of its sources.

    Raises UserError if the settings differ in their runs.
    """
    keys = ["replicate", "draws", *sources]
    runs = runs.sort_values([*keys, "run"])
    counts = runs.groupby(keys)["run"].agg(["count", "nunique", "max"])
    n = counts["count"].max()
    if not (counts.eq([n, n, n - 1]).all(axis=None)):
        wrong = counts[counts.ne([n, n, n - 1]).any(axis=1)]
        raise UserError(
            f"{len(wrong)} of {len(counts)} settings do not have the runs 0 to {n - 1} once each, "
            f"the first is {dict(zip(keys, wrong.index[0], strict=True))}.\n"
            "Hint: a file of runs is missing or there twice; run the registrations again."
        )
    return [_sample(part, tuple(sources), n) for _, part in runs.groupby("replicate")]


def _sample(runs, sources, n):
    first = runs.iloc[::n]
    return Sample(
        sources=sources,
        settings=first[list(sources)].to_numpy(dtype=float),
        draws=first["draws"].to_numpy(),
        xi=runs[XI].to_numpy(dtype=float).reshape(-1, n, 6),
        initial_xi=runs[INITIAL_XI].to_numpy(dtype=float).reshape(-1, n, 6),
        failed=~runs["status"].isin(divergence.GOOD_STATUS).to_numpy().reshape(-1, n),
        wrong_basin=runs["wrong_basin"].to_numpy(dtype=bool).reshape(-1, n),
        noise_draw=runs["noise_draw"].to_numpy()[:n],
    )


@dataclass(frozen=True)
class Estimates:
    """Quantities q of i games: value, low, high, draw_variance_ratio (i, q); n_used (i,)."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    draw_variance_ratio: np.ndarray
    n_used: np.ndarray


def estimate(sample, games, quantities, method, leave_out=None, intervals=True):
    """Quantities of games, rows (i, g) of the sample, with intervals, as `Estimates`.

    quantities: maps f (..., g) to (..., q). leave_out: whether runs in a wrong basin are left out
    (None: as the method says). A game with fewer than 50 runs left is NaN. An interval is widened
    to hold the value, which without bias correction may lie beside it.
    """
    corrected = method.bias_correction == "jackknife"
    bootstrap = BOOTSTRAP_DRAWS if intervals and method.interval == "bootstrap" else 0
    jackknife = corrected or (intervals and not bootstrap)
    width = quantities(np.zeros(games.shape[1])).shape[-1]
    value, low, high, ratio = np.full((4, len(games), width), np.nan)
    for members, plan, values in resampled(
        sample, games, quantities, method, jackknife, bootstrap, leave_out
    ):
        value[members] = plan.jackknife(values) if corrected else values[0]
        if intervals:
            ends = plan.interval(values)
            low[members] = np.minimum(ends[0], value[members])
            high[members] = np.maximum(ends[1], value[members])
            ratio[members] = plan.draw_variance_ratio(values)
    n_used = kept_runs(sample, games, method, leave_out).sum(axis=1)
    return Estimates(value, low, high, ratio, n_used)


def resampled(sample, games, quantities, method, jackknife, bootstrap, leave_out=None):
    """Resamples of the quantities of games (i, g), for all games that keep the same runs at once.

    Yields members (k,), numbers of games; their `Resampling`; values (r, k, q). Games with fewer
    than 50 runs left are passed over.
    """
    kept, group = np.unique(
        kept_runs(sample, games, method, leave_out), axis=0, return_inverse=True
    )
    for index in np.flatnonzero(kept.sum(axis=1) >= MINIMUM_RUNS):
        members = np.flatnonzero(group == index)
        rows, inverse = np.unique(games[members], return_inverse=True)
        plan = Resampling.of(kept[index], sample.noise_draw, jackknife, bootstrap, method.seed)
        f = evaluate(sample, rows, games[0, 0], plan.weights, method)
        by_game = f[inverse.reshape(-1, games.shape[1])]
        yield members, plan, quantities(np.moveaxis(by_game, -1, 0))


def kept_runs(sample, games, method, leave_out=None):
    """Which runs stay in each game (i, g): bool (i, n)."""
    dropped = sample.failed
    if method.leaves_out_wrong_basins if leave_out is None else leave_out:
        dropped = dropped | sample.wrong_basin
    return ~dropped[games].any(axis=1)


def evaluate(sample, rows, clean, weights, method):
    """f of settings `rows` (s,) against setting `clean`, under each weighting (r, n): (s, r).

    Raises UserError if a covariance is singular.
    """
    unbiased = method.bias_correction == "wishart"
    reference = divergence.spread(sample.xi[clean], weights, *method.floor)
    result = np.empty((len(rows), len(weights)))
    for start in range(0, len(rows), SETTINGS_AT_ONCE):
        part = slice(start, start + SETTINGS_AT_ONCE)
        perturbed = divergence.spread(sample.xi[rows[part]], weights, *method.floor)
        try:
            result[part] = method.reading.evaluate(reference, perturbed, unbiased)
        except np.linalg.LinAlgError as error:
            raise UserError(
                "The covariance of a setting is singular: its runs do not differ in some direction."
                "\nHint: set covariance_floor_rotation and covariance_floor_translation above 0."
            ) from error
    if method.reading.compares_with_clean:
        result[rows == clean] = 0.0  # no estimate: it has neither bias nor round-off
    return result


def uncertainty_table(sample, reference, method):
    """A row per setting: f with its interval and null, runs left out, errors, degeneracy.

    reference (M,): the reference values of the sources, the clean setting.
    """
    clean = int(sample.rows(reference))
    settings = np.arange(len(sample.settings))
    games = np.column_stack([np.full_like(settings, clean), settings])
    plain = replace(method, divergence="kl", bias_correction="none")
    kl = estimate(sample, games, _perturbed, plain, intervals=False)
    f = estimate(sample, games, _perturbed, method)
    null_mean, null_95 = null(f.n_used, method)
    covariance = degeneracy(sample, games, method)
    return pd.DataFrame(
        {
            **dict(zip(sample.sources, sample.settings.T, strict=True)),
            "draws": sample.draws,
            "f": f.value[:, 0],
            "f_low": f.low[:, 0],
            "f_high": f.high[:, 0],
            "f_draw_variance_ratio": f.draw_variance_ratio[:, 0],
            "kl": kl.value[:, 0],
            "null_mean": null_mean,
            "null_95": null_95,
            "n_runs": sample.xi.shape[1],
            "n_failed": sample.failed.sum(axis=1),
            "n_wrong_basin": sample.wrong_basin.sum(axis=1),
            "n_used": f.n_used,
            **covariance,
            **pose_error_columns(sample),
            "warning": [
                remarks(n, covariance["floor_share"][clean], covariance["memory"][clean])
                for n in f.n_used
            ],
        }
    )


def clean_again(sample, method):
    """The A/A value: f between the clean setting and its repetition; NaN if that was not run."""
    again = np.flatnonzero(sample.draws == 1)
    if len(again) == 0:
        return np.nan
    game = np.array([[sample.rows(sample.settings[again[0]]), again[0]]])
    return estimate(sample, game, _perturbed, method, intervals=False).value[0, 0]


def _perturbed(game):
    return game[..., 1:]


def null(n_used, method):
    """Mean and 95 % quantile of f where nothing is perturbed, for independent runs: (...) each."""
    numbers, inverse = np.unique(n_used, return_inverse=True)
    found = np.full((2, len(numbers)), np.nan)
    for column in np.flatnonzero(numbers >= MINIMUM_RUNS):
        n = int(numbers[column])
        corrected = method.bias_correction != "none"
        found[0, column] = divergence.null_mean(method.divergence, n, corrected)
        found[1, column] = null_quantile(method, n, 0.95)
    return found[:, inverse]


def null_quantile(method, n, probability):
    """Quantile of f where nothing is perturbed, for n independent Gaussian runs."""
    corrected = method.bias_correction != "none"
    return divergence.null_quantile(method.divergence, int(n), probability, corrected)


def degeneracy(sample, games, method):
    """How far the covariance of the last setting of each game (i, g) can be trusted, by column.

    logdet, condition and smallest_standard_deviation of the covariance with its floor, rad and m
    counted alike; floor_share: the floor's largest share in the variance of a direction; memory:
    the largest share of a pose component's variance that follows the initial pose.
    """
    kept = kept_runs(sample, games, method)
    names = ("logdet", "condition", "smallest_standard_deviation", "floor_share", "memory")
    columns = {name: np.full(len(games), np.nan) for name in names}
    for game in np.flatnonzero(kept.sum(axis=1) >= MINIMUM_RUNS):
        row = games[game, -1]
        xi = sample.xi[row, kept[game]]
        covariance = divergence.covariance(xi, *method.floor)
        variances = np.linalg.eigvalsh(covariance)
        columns["logdet"][game] = divergence.log_determinant(covariance)
        columns["condition"][game] = variances[-1] / variances[0]
        columns["smallest_standard_deviation"][game] = np.sqrt(variances[0])
        columns["floor_share"][game] = divergence.floor_share(covariance, *method.floor)
        right = kept[game] & ~sample.wrong_basin[row]
        columns["memory"][game] = memory(sample.initial_xi[row, right], sample.xi[row, right])
    return columns


def memory(initial_xi, xi):
    """Largest share of a component's variance in xi (n, 6) that is linear in initial_xi (n, 6).

    The adjusted R^2: about 0 where ICP converged, for then it has forgotten where it started. NaN
    for fewer than two runs a parameter.
    """
    n, parameters = len(xi), initial_xi.shape[1] + 1
    if n < 2 * parameters:
        return np.nan
    design = np.column_stack([np.ones(n), initial_xi])
    residual = xi - design @ np.linalg.lstsq(design, xi)[0]
    unexplained = np.square(residual).sum(axis=0) / (n - parameters)
    variance = xi.var(axis=0, ddof=1)
    share = 1.0 - np.divide(unexplained, variance, out=np.ones(6), where=variance > 0)
    return max(0.0, share.max())


def pose_error_columns(sample):
    """Errors about the ground truth of the runs that did not fail, wrong basins included."""
    translation, rotation = (
        np.where(sample.failed, np.nan, error) for error in divergence.pose_errors(sample.xi)
    )
    success = (translation <= SUCCESS_TRANSLATION) & (rotation <= SUCCESS_ROTATION)
    with warnings.catch_warnings():
        # NaN is the mean of a setting of which every run failed.
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return {
            "mean_translation_error": np.nanmean(translation, axis=1),
            "mean_rotation_error": np.nanmean(rotation, axis=1),
            "translation_rmse": np.sqrt(np.nanmean(translation**2, axis=1)),
            "rotation_rmse": np.sqrt(np.nanmean(rotation**2, axis=1)),
            "success_rate": np.nanmean(success.astype(float), axis=1),
        }


def remarks(n_used, clean_floor_share, clean_memory):
    """What makes f or phi doubtful, in words; empty if nothing does."""
    found = []
    if n_used < MINIMUM_RUNS:
        found.append(f"only {n_used} runs left, fewer than {MINIMUM_RUNS}: no value")
    if clean_floor_share > 0.5:
        found.append(
            f"the floor makes up {clean_floor_share:.0%} of the clean variance in one direction"
        )
    if clean_memory > 0.5:
        found.append(
            f"the initial pose explains {clean_memory:.0%} of the clean variance of a component: "
            "it shows where the iteration stops"
        )
    return "; ".join(found)
