"""From the runs of one pair to its uncertainties and their explanation, with intervals.

Words: a *game* is the list of settings (rows of a `Sample`) whose f are combined, the clean
setting first. Runs left out of one setting of a game are left out of all of them.
"""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from icpshap import divergence, shapley
from icpshap.intervals import Resampling, mean_interval

MINIMUM_RUNS = 50
BOOTSTRAP_DRAWS = 1000
GOOD_STATUS = ("ok", "max_iterations")
SUCCESS_TRANSLATION = 0.1
SUCCESS_ROTATION = np.deg2rad(2.0)
XI = [f"xi_{i}" for i in range(6)]
SETTINGS_AT_ONCE = 64


@dataclass(frozen=True)
class Method:
    """How runs become numbers: keys of an estimator in the configuration, under the same names.

    covariance_floor_rotation [rad], covariance_floor_translation [m]; divergence: a key of
    `divergence.READINGS`; wrong_basins: keep or leave_out; bias_correction: none, jackknife or
    wishart; interval: jackknife or bootstrap. stop_rotation [rad] and stop_translation [m], the
    steps below which the chain stops, only serve a warning; seed is the bootstrap's.
    """

    covariance_floor_rotation: float = 1e-6
    covariance_floor_translation: float = 1e-6
    divergence: str = "kl"
    wrong_basins: str = "keep"
    bias_correction: str = "none"
    interval: str = "jackknife"
    stop_rotation: float = 0.0
    stop_translation: float = 0.0
    seed: int = 0

    @property
    def reading(self):
        return divergence.READINGS[self.divergence]

    @property
    def floor(self):
        return self.covariance_floor_rotation, self.covariance_floor_translation

    def with_floor(self, factor):
        """The same with `factor` times the covariance floor (as a standard deviation)."""
        rotation, translation = (factor * floor for floor in self.floor)
        return replace(
            self, covariance_floor_rotation=rotation, covariance_floor_translation=translation
        )


@dataclass(frozen=True)
class Sample:
    """The runs of one pair and one seed: S settings with the same n runs in each.

    sources: names; settings (S, M): their values; draws (S,): 0, or 1 for the clean setting run
    again with independent random draws; xi (S, n, 6): pose errors, rotation [rad] first; status
    and basins: failed, wrong_basin (S, n); noise_draw (n,): the noise draw that a run used.
    """

    sources: tuple
    settings: np.ndarray
    draws: np.ndarray
    xi: np.ndarray
    failed: np.ndarray
    wrong_basin: np.ndarray
    noise_draw: np.ndarray

    def rows(self, values, draws=0):
        """Row of each setting in values (..., M). Raises KeyError if one was not run."""
        values = np.asarray(values, dtype=float)
        table = pd.MultiIndex.from_arrays([*self.settings.T, self.draws])
        flat = values.reshape(-1, values.shape[-1])
        wanted = pd.MultiIndex.from_arrays([*flat.T, np.full(len(flat), draws)])
        rows = table.get_indexer(wanted)
        if (rows < 0).any():
            missing = flat[rows < 0]
            setting = ", ".join(f"{s}={v:g}" for s, v in zip(self.sources, missing[0], strict=True))
            raise KeyError(
                f"No runs of setting {setting} (draws {draws}); {len(np.unique(missing, axis=0))} "
                f"settings are missing, {len(self.settings)} are there.\n"
                "Hint: the runs belong to another configuration; run the registrations again."
            )
        return rows.reshape(values.shape[:-1])


def samples(runs, sources):
    """One `Sample` per replicate of a pair's runs table (columns: DESIGN, `runs/`).

    sources: names of the uncertainty sources. Optional columns: replicate (independent seeds) and
    draws (1: the clean setting run again with independent draws). Raises ValueError if settings
    differ in their runs.
    """
    sources = list(sources)
    runs = runs.assign(**{c: 0 for c in ("replicate", "draws") if c not in runs})
    runs = runs.sort_values(["replicate", "draws", *sources, "run"])
    return [_sample(part, sources) for _, part in runs.groupby("replicate", sort=True)]


def _sample(runs, sources):
    keys = runs[["draws", *sources]].to_numpy(dtype=float)
    starts = np.flatnonzero(np.r_[True, (keys[1:] != keys[:-1]).any(axis=1)])
    counts = np.diff(np.r_[starts, len(runs)])
    index = runs["run"].to_numpy()
    n = counts[0]
    if (counts != n).any() or (index.reshape(-1, n) != index[:n]).any():
        settings = dict(
            zip(["draws", *sources], keys[starts[counts != n][:1]].ravel(), strict=False)
        )
        raise ValueError(
            f"The settings of a pair must have the same runs; found {counts.min()} to "
            f"{counts.max()} a setting {settings or ''}.\n"
            "Hint: a chunk of runs is missing or there twice; run the registrations again."
        )
    shape = (len(starts), n)
    return Sample(
        sources=tuple(sources),
        settings=keys[starts, 1:],
        draws=keys[starts, 0].astype(int),
        xi=runs[XI].to_numpy(dtype=float).reshape(*shape, 6),
        failed=~runs["status"].isin(GOOD_STATUS).to_numpy().reshape(shape),
        wrong_basin=runs["wrong_basin"].to_numpy(dtype=bool).reshape(shape),
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


def kept_runs(sample, games, leave_out_wrong_basins):
    """Which runs stay in each game (i, g): bool (i, n)."""
    dropped = sample.failed
    if leave_out_wrong_basins:
        dropped = dropped | sample.wrong_basin
    return ~dropped[games].any(axis=1)


def evaluate(sample, rows, clean, weights, method):
    """f of settings `rows` (s,) against setting `clean`, under each weighting (r, n): (s, r)."""
    unbiased = method.bias_correction == "wishart"
    reference = divergence.spread(sample.xi[clean], weights, *method.floor)
    parts = np.array_split(rows, -(-len(rows) // SETTINGS_AT_ONCE))
    return np.concatenate(
        [
            method.reading.evaluate(
                reference, divergence.spread(sample.xi[part], weights, *method.floor), unbiased
            )
            for part in parts
        ]
    )


def estimate(sample, games, quantities, method, leave_out=None, intervals=True):
    """Quantities of games (i, g) with intervals, as `Estimates`.

    quantities: maps f (..., g) to (..., q). leave_out: whether runs in a wrong basin are left out
    (None: as the method says). A game with fewer than 50 runs left is NaN.
    """
    if leave_out is None:
        leave_out = method.wrong_basins == "leave_out"
    jackknife = method.bias_correction == "jackknife"
    bootstrap = BOOTSTRAP_DRAWS if intervals and method.interval == "bootstrap" else 0
    leave_one_out = jackknife or (intervals and not bootstrap)

    kept, group = np.unique(kept_runs(sample, games, leave_out), axis=0, return_inverse=True)
    shape = (len(games), quantities(np.zeros(games.shape[1])).shape[-1])
    value, low, high, ratio = np.full((4, *shape), np.nan)
    for index, runs in enumerate(kept):
        if runs.sum() < MINIMUM_RUNS:
            continue
        members = np.flatnonzero(group == index)
        rows, inverse = np.unique(games[members], return_inverse=True)
        plan = Resampling.of(runs, sample.noise_draw, leave_one_out, bootstrap, method.seed)
        f = evaluate(sample, rows, games[0, 0], plan.weights, method)
        # (weighting, game, quantity)
        values = quantities(np.moveaxis(f[inverse.reshape(-1, games.shape[1])], -1, 0))
        value[members] = plan.jackknife(values) if jackknife else values[0]
        if intervals:
            low[members], high[members] = plan.interval(values)
        if leave_one_out:
            ratio[members] = plan.draw_variance_ratio(values)
    return Estimates(value, low, high, ratio, kept.sum(axis=1)[group])


def explain(runs, instances, sources, method, pair, reason=""):
    """Uncertainty table (a row per setting and replicate) and shap table (a row per instance).

    runs: the runs table of one pair; instances: table with `instance` and a column per source;
    sources: mapping of the uncertainty sources' names to their reference values; pair: (sequence,
    reference, source). With a reason the pair was not registered: both tables hold NaN and it.
    """
    reference = list(sources.values())
    games = shapley.coalition_values(instances[list(sources)], reference)
    replicates = [_nothing(sources, games)] if reason else samples(runs, sources)
    uncertainty = [uncertainty_table(sample, reference, method) for sample in replicates]
    uncertainty = pd.concat(uncertainty, keys=range(len(replicates)), names=["replicate", None])
    uncertainty = uncertainty.reset_index("replicate").reset_index(drop=True)
    shap = shap_table(replicates, instances, games, method)
    for table in (uncertainty, shap):
        table["reason"] = reason
        if reason:
            table["warning"] = ""
        for position, column in enumerate(("sequence", "reference", "source")):
            table.insert(position, column, pair[position])
    return uncertainty, shap


def _nothing(sources, games):
    """The sample of a pair that was not registered: every setting, no run."""
    settings = np.unique(games.reshape(-1, len(sources)), axis=0)
    no_run = np.zeros((len(settings), 0), dtype=bool)
    return Sample(
        sources=tuple(sources),
        settings=settings,
        draws=np.zeros(len(settings), dtype=int),
        xi=np.zeros((*no_run.shape, 6)),
        failed=no_run,
        wrong_basin=no_run,
        noise_draw=np.zeros(0, dtype=int),
    )


def uncertainty_table(sample, reference, method):
    """A row per setting of a sample: f with interval, null, runs, errors, degeneracy."""
    clean = sample.rows(reference)
    games = np.column_stack([np.full(len(sample.settings), clean), np.arange(len(sample.settings))])
    f = estimate(sample, games, lambda game: game[..., 1:], method)
    plain = replace(method, divergence="kl", bias_correction="none")
    kl = estimate(sample, games, lambda game: game[..., 1:], plain, intervals=False)
    table = pd.DataFrame(dict(zip(sample.sources, sample.settings.T, strict=True)))
    table["draws"] = sample.draws
    table["f"], table["f_low"], table["f_high"] = f.value[:, 0], f.low[:, 0], f.high[:, 0]
    table["f_draw_variance_ratio"] = f.draw_variance_ratio[:, 0]
    table["kl"] = kl.value[:, 0]
    table["null_mean"], table["null_95"] = null_columns(f.n_used, method)
    table["n_runs"] = sample.xi.shape[1]
    table["n_failed"] = sample.failed.sum(axis=1)
    table["n_wrong_basin"] = sample.wrong_basin.sum(axis=1)
    table["n_used"] = f.n_used
    table = table.assign(**degeneracy(sample, games, method), **error_columns(sample))
    clean_warning = clean_covariance_warning(sample, clean, method)
    table["warning"] = [
        "; ".join(filter(None, (too_few_warning(n), clean_warning))) for n in f.n_used
    ]
    return table


def shap_table(replicates, instances, games, method):
    """A row per instance: f and Shapley values with intervals, interactions, sensitivities.

    games (i, 2^M, M) are the settings of each instance's coalitions. With several replicates
    values are means over them, and intervals come from their spread.
    """
    sources = replicates[0].sources
    reported = ["f", *(f"phi_{a}" for a in sources)]
    reported += [f"interaction_{a}_{b}" for a, b in shapley.pairs(sources)]
    names = ["base_value", *reported, *(f"regression_{a}" for a in sources)]
    rows = [sample.rows(games) for sample in replicates]

    def estimates(method, **keywords):
        return [
            estimate(sample, row, shap_quantities, method, **keywords)
            for sample, row in zip(replicates, rows, strict=True)
        ]

    def values(method, **keywords):
        found = estimates(method, intervals=False, **keywords)
        return dict(zip(names, np.mean([e.value for e in found], axis=0).T, strict=True))

    main = estimates(method)
    if len(replicates) > 1:
        value, low, high = mean_interval(np.array([e.value for e in main]))
    else:
        value, low, high = main[0].value, main[0].low, main[0].high
    value, low, high = (dict(zip(names, part.T, strict=True)) for part in (value, low, high))
    ratio = dict(zip(names, np.mean([e.draw_variance_ratio for e in main], axis=0).T, strict=True))
    variants = {
        "all": values(method, leave_out=False),
        "right_basin": values(method, leave_out=True),
        "floor_tenfold": values(method.with_floor(10.0)),
        "floor_tenth": values(method.with_floor(0.1)),
    }

    table = instances[["instance", *sources]].reset_index(drop=True)
    columns = {"base_value": value["base_value"]}
    for name in reported:
        columns |= {name: value[name], f"{name}_low": low[name], f"{name}_high": high[name]}
        if name.startswith("phi_"):
            columns[f"{name}_significant"] = (low[name] > 0) | (high[name] < 0)
            columns[f"{name}_draw_variance_ratio"] = ratio[name]
        if not name.startswith("interaction_"):
            columns |= {f"{name}_{variant}": found[name] for variant, found in variants.items()}
    phi, regression = (
        np.column_stack([value[f"{kind}_{a}"] for a in sources]) for kind in ("phi", "regression")
    )
    largest = np.abs(phi).max(axis=1)
    columns["regression_difference"] = np.abs(regression - phi).max(axis=1) / np.where(
        largest > 0, largest, 1.0
    )
    columns["f_again"] = np.mean([clean_again(sample, method) for sample in replicates])
    n_used = np.min([e.n_used for e in main], axis=0)
    columns["null_mean"], columns["null_95"] = null_columns(n_used, method)
    columns["n_runs"] = replicates[0].xi.shape[1]
    columns["n_used"] = n_used
    for count in ("failed", "wrong_basin"):
        columns[f"n_{count}"] = sum(
            getattr(sample, count)[row].any(axis=1).sum(axis=1)
            for sample, row in zip(replicates, rows, strict=True)
        )
    columns["interval_over"] = interval_over(replicates)
    clean = [
        clean_covariance_warning(sample, row[0, 0], method)
        for sample, row in zip(replicates, rows, strict=True)
    ]
    columns["warning"] = [
        "; ".join(dict.fromkeys(filter(None, (too_few_warning(n), *clean)))) for n in n_used
    ]
    return table.assign(**columns)


def shap_quantities(game):
    """What is read off games (..., 2^M): base value, f, phi, interactions, phi by regression."""
    parts = [game[..., :1], game[..., -1:], shapley.shapley_values(game)]
    parts += [shapley.interaction_indices(game), shapley.kernel_regression(game)]
    return np.concatenate(parts, axis=-1)


def clean_again(sample, method):
    """A/A value: f between the clean setting and its repetition; NaN if that was not run."""
    again = np.flatnonzero(sample.draws == 1)
    if len(again) == 0:
        return np.nan
    clean = sample.rows(sample.settings[again[0]])
    game = np.array([[clean, again[0]]])
    return estimate(sample, game, lambda g: g[..., 1:], method, intervals=False).value[0, 0]


def null_columns(n_used, method):
    """Mean and 95 % quantile of f where nothing was perturbed, for independent Gaussian runs."""
    unbiased = method.bias_correction != "none"
    numbers, inverse = np.unique(n_used, return_inverse=True)
    enough = numbers >= MINIMUM_RUNS
    mean, quantile = np.full((2, len(numbers)), np.nan)
    for row in np.flatnonzero(enough):
        n = int(numbers[row])
        mean[row] = divergence.null_mean(method.divergence, n, unbiased)
        quantile[row] = divergence.null_quantile(method.divergence, n, 0.95, unbiased)
    return mean[inverse], quantile[inverse]


def degeneracy(sample, games, method):
    """Columns on the covariance of the last setting of each game (i, g), floor included.

    logdet; condition number and smallest_standard_deviation over directions in which rad and m
    count alike; floor_share, the largest share of the floor in the variance of a direction.
    """
    kept = kept_runs(sample, games, method.wrong_basins == "leave_out")
    covariances = np.full((len(games), 6, 6), np.nan)
    enough = kept.sum(axis=1) >= MINIMUM_RUNS
    for row in np.flatnonzero(enough):
        spread = divergence.spread(sample.xi[games[row, -1]], kept[row][None], *method.floor)
        covariances[row] = spread.covariance[0]
    columns = {
        name: np.full(len(games), np.nan)
        for name in ("logdet", "condition", "smallest_standard_deviation", "floor_share")
    }
    variances = np.linalg.eigvalsh(covariances[enough])
    columns["logdet"][enough] = divergence.log_determinant(covariances[enough])
    columns["condition"][enough] = variances[:, -1] / variances[:, 0]
    columns["smallest_standard_deviation"][enough] = np.sqrt(variances[:, 0])
    columns["floor_share"][enough] = divergence.floor_share(covariances[enough], *method.floor)
    return columns


def error_columns(sample):
    """Pose errors about the ground truth of the runs that did not fail, wrong basins included."""
    translation, rotation = divergence.pose_errors(sample.xi)
    translation, rotation = (
        np.where(sample.failed, np.nan, error) for error in (translation, rotation)
    )
    success = (translation <= SUCCESS_TRANSLATION) & (rotation <= SUCCESS_ROTATION)
    with warnings.catch_warnings():
        # A setting of which no run is left has NaN here.
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return {
            "mean_translation_error": np.nanmean(translation, axis=1),
            "mean_rotation_error": np.nanmean(rotation, axis=1),
            "translation_rmse": np.sqrt(np.nanmean(translation**2, axis=1)),
            "rotation_rmse": np.sqrt(np.nanmean(rotation**2, axis=1)),
            "success_rate": np.nanmean(success.astype(float), axis=1),
        }


def too_few_warning(n_used):
    if n_used >= MINIMUM_RUNS:
        return ""
    return f"only {n_used} runs left, fewer than {MINIMUM_RUNS}: no value"


def clean_covariance_warning(sample, clean, method):
    """Why the clean covariance may say more about the method than about the registration."""
    game = np.array([[clean]])
    share = degeneracy(sample, game, method)["floor_share"][0]
    if np.isnan(share):
        return ""
    found = []
    if share > 0.5:
        found.append(f"the floor makes up {share:.0%} of the clean variance in one direction")
    kept = kept_runs(sample, game, method.wrong_basins == "leave_out")[0]
    deviation = sample.xi[clean, kept].std(axis=0, ddof=1)
    tolerance = np.repeat([method.stop_rotation, method.stop_translation], 3)
    if (deviation < tolerance).all():
        found.append("the clean spread lies inside the steps at which the chain stops")
    return "; ".join(found)


def interval_over(replicates):
    """What the intervals are taken over: replicates, noise draws or runs."""
    if len(replicates) > 1:
        return "replicates"
    return "noise draws" if len(np.unique(replicates[0].noise_draw)) > 1 else "runs"
