"""What each uncertainty source contributes to the uncertainty of a pair, and how sure that is."""

from dataclasses import replace

import numpy as np
import pandas as pd

from icpshap.errors import UserError
from icpshap.explanation import shapley
from icpshap.explanation.intervals import mean_interval
from icpshap.explanation.uncertainty import (
    MINIMUM_RUNS,
    Estimates,
    Method,
    Sample,
    clean_again,
    degeneracy,
    estimate,
    null,
    null_quantile,
    remarks,
    resampled,
    samples,
    uncertainty_table,
)

__all__ = ["Method", "explain", "load_explanation", "resampled_values"]

PAIR = ("sequence", "reference", "source")
AGAIN_PROBABILITY = 0.99


def explain(runs, instances, sources, method, pair, reason=""):
    """Uncertainty table (a row per setting and replicate) and shap table (a row per instance).

    runs: the runs table of one pair; instances: table with `instance` and a column per source;
    sources: reference value of each uncertainty source by name; pair: (sequence, reference,
    source). With a reason the pair was not registered: both tables hold NaN and that reason.
    """
    reference = list(sources.values())
    games = shapley.coalition_values(instances[list(sources)], reference)
    if reason:
        settings = np.unique(games.reshape(-1, len(sources)), axis=0)
        replicates = [Sample.without_runs(sources, settings)]
    else:
        replicates = samples(runs, sources)
    uncertainty = pd.concat(
        [
            uncertainty_table(sample, reference, method).assign(replicate=replicate)
            for replicate, sample in enumerate(replicates)
        ],
        ignore_index=True,
    )
    shap = shap_table(replicates, instances, games, method)
    for table in (uncertainty, shap):
        table["reason"] = reason
        if reason:
            table["warning"] = ""
        for position, column in enumerate(PAIR):
            table.insert(position, column, pair[position])
    return uncertainty, shap


def quantities(game):
    """What is read off games (..., 2^M): base value, f, phi, interactions, phi by regression."""
    parts = [game[..., :1], game[..., -1:], shapley.shapley_values(game)]
    parts += [shapley.interaction_indices(game), shapley.kernel_regression(game)]
    return np.concatenate(parts, axis=-1)


def quantity_names(sources):
    """Names of what `quantities` returns."""
    names = ["base_value", "f", *(f"phi_{a}" for a in sources)]
    names += [f"interaction_{a}_{b}" for a, b in shapley.pairs(sources)]
    return [*names, *(f"regression_{a}" for a in sources)]


def shap_table(replicates, instances, games, method):
    """A row per instance: f, Shapley values and interactions with intervals, and sensitivities.

    replicates: list of `Sample`; games (i, 2^M, M): the settings of each instance's coalitions.
    With several replicates values are means over them, and their spread gives the intervals.
    """
    sources = list(replicates[0].sources)
    rows = [sample.rows(games) for sample in replicates]
    found = _combined(replicates, rows, method)
    n_used = found.n_used.min(axis=0)
    f_again = np.mean([clean_again(sample, method) for sample in replicates])
    variants = {
        "all": _combined(replicates, rows, method, leave_out=False, intervals=False),
        "right_basin": _combined(replicates, rows, method, leave_out=True, intervals=False),
        "floor_tenfold": _combined(replicates, rows, method.with_floor(10.0), intervals=False),
        "floor_tenth": _combined(replicates, rows, method.with_floor(0.1), intervals=False),
    }
    n_right_basin = variants["right_basin"].n_used.min(axis=0)
    null_mean, null_95 = null(n_used, method)
    columns = {
        **_estimate_columns(sources, found, variants),
        "regression_difference": _regression_difference(found.value, len(sources)),
        "f_again": f_again,
        "null_mean": null_mean,
        "null_95": null_95,
        "n_runs": sum(sample.xi.shape[1] for sample in replicates),
        "n_used": found.n_used.sum(axis=0),
        "n_failed": _runs_anywhere([sample.failed for sample in replicates], rows),
        "n_wrong_basin": _runs_anywhere([sample.wrong_basin for sample in replicates], rows),
        "interval_over": _interval_over(replicates),
        "warning": _warnings(replicates, rows, n_used, n_right_basin, f_again, method),
    }
    return instances[["instance", *sources]].reset_index(drop=True).assign(**columns)


def _combined(replicates, rows, method, **options):
    """`Estimates` of games over all replicates: means; n_used (replicates, i)."""
    found = [
        estimate(sample, row, quantities, method, **options)
        for sample, row in zip(replicates, rows, strict=True)
    ]
    n_used = np.array([part.n_used for part in found])
    if len(found) == 1:
        return replace(found[0], n_used=n_used)
    value, low, high = mean_interval(np.array([part.value for part in found]))
    ratio = np.mean([part.draw_variance_ratio for part in found], axis=0)
    return Estimates(value, low, high, ratio, n_used)


def _estimate_columns(sources, found, variants):
    columns = {"base_value": found.value[:, 0]}
    for q, name in enumerate(quantity_names(sources)[1 : -len(sources)], start=1):
        value, low, high = found.value[:, q], found.low[:, q], found.high[:, q]
        columns |= {name: value, f"{name}_low": low, f"{name}_high": high}
        if name.startswith("phi_"):
            columns[f"{name}_significant"] = (low > 0) | (high < 0)
            columns[f"{name}_draw_variance_ratio"] = found.draw_variance_ratio[:, q]
        if not name.startswith("interaction_"):
            columns |= {f"{name}_{kind}": other.value[:, q] for kind, other in variants.items()}
    return columns


def _regression_difference(value, players):
    """Largest difference of phi to Algorithm 1's regression, relative to the largest |phi|."""
    phi, regression = value[:, 2 : 2 + players], value[:, -players:]
    largest = np.abs(phi).max(axis=1)
    return np.abs(regression - phi).max(axis=1) / np.where(largest > 0, largest, 1.0)


def _runs_anywhere(marks, rows):
    """Runs (i) that are marked in at least one setting of a game, over all replicates."""
    return sum(mark[row].any(axis=1).sum(axis=1) for mark, row in zip(marks, rows, strict=True))


def _warnings(replicates, rows, n_used, n_right_basin, f_again, method):
    """A text for each game: `remarks`, and what the wrong basins and the A/A value tell."""
    clean = [
        degeneracy(sample, row[:1, :1], method)
        for sample, row in zip(replicates, rows, strict=True)
    ]
    floor_share, memory = (max(part[key][0] for part in clean) for key in ("floor_share", "memory"))
    texts = []
    for n, right in zip(n_used, n_right_basin, strict=True):
        found = [remarks(n, floor_share, memory)]
        if right < MINIMUM_RUNS <= n:
            found.append(
                f"fewer than {MINIMUM_RUNS} runs are never in a wrong basin: no value without those"
            )
        if n >= MINIMUM_RUNS and f_again > null_quantile(method, n, AGAIN_PROBABILITY):
            found.append(
                f"two clean samples differ by {f_again:.2g}, more than Gaussian ones would: a few "
                "runs make up the covariance"
            )
        texts.append("; ".join(filter(None, found)))
    return texts


def _interval_over(replicates):
    if len(replicates) > 1:
        return "replicates"
    return "noise draws" if len(np.unique(replicates[0].noise_draw)) > 1 else "runs"


def resampled_values(runs, instances, sources, method, pair, number=200):
    """Shapley values of bootstrap samples of a pair's runs: a row per instance and resample.

    Whole noise draws are drawn again where there are several. Each resample is mirrored at the
    value of the shap table (basic bootstrap), so that the rows spread as the truth may.
    """
    games = shapley.coalition_values(instances[list(sources)], list(sources.values()))
    mirrored = np.mean(
        [
            _mirrored(sample, sample.rows(games), method, number)
            for sample in samples(runs, sources)
        ],
        axis=0,
    )
    index = pd.MultiIndex.from_product(
        [instances["instance"], range(number)], names=["instance", "resample"]
    )
    table = pd.DataFrame(
        np.swapaxes(mirrored, 0, 1).reshape(-1, len(sources)),
        index=index,
        columns=[f"phi_{name}" for name in sources],
    ).reset_index()
    for position, column in enumerate(PAIR):
        table.insert(position, column, pair[position])
    return table


def _mirrored(sample, rows, method, number):
    """Mirrored Shapley values (number, i, M) of games (i, 2^M), rows of a sample."""
    value = estimate(sample, rows, shapley.shapley_values, method, intervals=False).value
    result = np.full((number, *value.shape), np.nan)
    for members, plan, values in resampled(
        sample, rows, shapley.shapley_values, method, jackknife=False, bootstrap=number
    ):
        result[:, members] = value[members] + values[0] - values[plan.bootstrap]
    return result


def load_explanation(path):
    """The shap.Explanation of a shap.parquet: values, base values, data, names and bounds.

    Rows without a value (`reason` or `warning` says why) are left out. Raises UserError if the
    file holds no Shapley values.
    """
    import shap

    table = pd.read_parquet(path)
    names = [
        column.removeprefix("phi_").removesuffix("_low")
        for column in table
        if column.startswith("phi_") and column.endswith("_low")
    ]
    if not names:
        raise UserError(
            f"{path}: no column phi_<uncertainty source>_low.\n"
            "Hint: give the path of a shap.parquet, such as results/<experiment>/shap.parquet."
        )
    phi = [f"phi_{name}" for name in names]
    table = table.dropna(subset=phi)
    return shap.Explanation(
        values=table[phi].to_numpy(),
        base_values=table["base_value"].to_numpy(),
        data=table[names].to_numpy(),
        feature_names=names,
        lower_bounds=table[[f"{name}_low" for name in phi]].to_numpy(),
        upper_bounds=table[[f"{name}_high" for name in phi]].to_numpy(),
    )
