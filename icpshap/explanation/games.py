"""What each cause contributes to the uncertainty of a pair, and how sure that is: its tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from icpshap.errors import UserError, extra
from icpshap.explanation import shapley
from icpshap.explanation.directions import directions_table
from icpshap.explanation.doubts import (
    clean_again,
    degeneracy,
    independent,
    most_far,
    no_interval,
    null,
    remarks,
    remarks_of_games,
)
from icpshap.explanation.pose_errors import pose_error_columns
from icpshap.explanation.sample import Sample, samples
from icpshap.explanation.sensor_sigma import with_sensor_sigma
from icpshap.explanation.shares import explain_shares, wrong_basin_shares
from icpshap.explanation.shrinking import shrinking_columns
from icpshap.explanation.uncertainty import (
    Estimate,
    columns_of,
    covariances,
    estimate,
    kept_runs,
    over_replicates,
    perturbed,
    resampled,
    with_ends,
)
from icpshap.tables import COVARIANCE, TRANSFORM

if TYPE_CHECKING:
    import shap
    from numpy.typing import ArrayLike

    from icpshap.estimators.kind import Returns
    from icpshap.explanation.method import Method
    from icpshap.explanation.scan_pair import ScanPair


@dataclass(frozen=True)
class Explained:
    """What is read off i games of M causes: an `Estimate` (i, q) of each quantity by its name.

    base_value and f (q = 1): f of the clean setting and of the instance; phi (M); interactions (of
    the couples of causes, in their order); removal (M): what f falls by without a cause; regression
    (M): phi by Algorithm 1. n_used: runs left in each replicate and game (replicates, i).
    """

    base_value: Estimate
    f: Estimate
    phi: Estimate
    interactions: Estimate
    removal: Estimate
    regression: Estimate
    n_used: np.ndarray


QUANTITIES = {
    "base_value": lambda game: game[..., :1],
    "f": lambda game: game[..., -1:],
    "phi": shapley.shapley_values,
    "interactions": shapley.interaction_indices,
    "removal": shapley.removal_effects,
    "regression": shapley.kernel_regression,
}


def quantities(game: np.ndarray) -> np.ndarray:
    """All `QUANTITIES` of games (..., 2^M), side by side."""
    return np.concatenate([read(game) for read in QUANTITIES.values()], axis=-1)


def explain_games(
    replicates: list[Sample], rows: list[np.ndarray], method: Method, **options: Any
) -> Explained:
    """`Explained` of games, rows (i, 2^M) of each replicate; options: of `estimate`.

    With several replicates values are means over them, and their spread gives the intervals.
    """
    found = [
        estimate(sample, row, quantities, method, **options)
        for sample, row in zip(replicates, rows, strict=True)
    ]
    together = over_replicates(found)
    left_out = options.get("leave_out")
    n_used = [
        kept_runs(sample, row, method, left_out).sum(axis=1)
        for sample, row in zip(replicates, rows, strict=True)
    ]
    game = np.zeros(rows[0].shape[1])
    ends = np.cumsum([read(game).shape[-1] for read in QUANTITIES.values()])
    parts = np.split(np.arange(ends[-1]), ends[:-1])
    by_name = dict(zip(QUANTITIES, map(together.part, parts), strict=True))
    return Explained(**by_name, n_used=np.array(n_used))


class Explanation(NamedTuple):
    """The tables of a pair.

    A row per setting and replicate, per instance, per direction of one, and again per setting.
    """

    uncertainty: pd.DataFrame
    shap: pd.DataFrame
    directions: pd.DataFrame
    covariances: pd.DataFrame


def explain(
    runs: pd.DataFrame | None,
    estimates: pd.DataFrame | None,
    instances: pd.DataFrame,
    off: Mapping[str, float],
    returns: Returns,
    method: Method,
    pair: ScanPair,
    reason: str = "",
) -> Explanation:
    """The `Explanation` of one pair.

    runs, estimates: its tables (None if not returned); instances: table with `instance` and a
    column per cause; off: reference value of each cause by name; returns: kind.Returns; pair:
    `scan_pair.ScanPair`. With a reason the pair was not registered: the tables hold NaN and that
    reason.
    """
    reference = np.array(list(off.values()))
    games = shapley.coalition_values(instances[list(off)], reference)
    if reason:
        settings = np.unique(games.reshape(-1, len(off)), axis=0)
        replicates = [Sample.without_runs(off, settings, returns)]
    else:
        replicates = samples(runs, estimates, off, returns, method, pair.characteristic_length)
    rows = [sample.rows(games) for sample in replicates]
    uncertainty, spreads = (
        pd.concat(
            [
                table(sample, reference, method).assign(replicate=replicate)
                for replicate, sample in enumerate(replicates)
            ],
            ignore_index=True,
        )
        for table in (uncertainty_table, covariances_table)
    )
    spreads[TRANSFORM] = pair.T_reference_source.ravel()
    shap = shap_table(replicates, instances, rows, off, method)
    directions = directions_table(replicates, instances, rows, method, pair)
    if reason:
        uncertainty["warning"] = shap["warning"] = ""
    tables = (uncertainty, shap, directions, spreads)
    return Explanation(*(_of_pair(pair, table, reason=reason) for table in tables))


def _of_pair(pair, table, **columns):
    """A table with the columns that name the pair before its own, and others behind."""
    named = pd.DataFrame(pair.columns, index=table.index)
    return pd.concat([named, table, pd.DataFrame(columns, index=table.index)], axis=1)


def uncertainty_table(sample: Sample, reference: ArrayLike, method: Method) -> pd.DataFrame:
    """A row per setting: f with its interval and null, runs left out, errors, degeneracy.

    reference (M,): the reference values of the causes, the clean setting.
    """
    games = games_of_settings(sample, reference)
    clean = games[0, 0]
    plain = replace(method, divergence="kl", bias_correction="none")
    kl = estimate(sample, games, perturbed, plain, intervals=False)
    f = estimate(sample, games, perturbed, method)
    share, share_low, share_high = wrong_basin_shares(sample)
    if method.reading.counts_failed:  # f is that share: one interval a number
        f = with_ends(f, share_low[:, None], share_high[:, None])
    n_used = kept_runs(sample, games, method).sum(axis=1)
    null_mean, null_95 = null(independent(n_used, sample, games), sample, method)
    covariance = degeneracy(sample, games, method)
    return pd.DataFrame(
        {
            **dict(zip(sample.causes, sample.settings.T, strict=True)),
            "again": sample.again,
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
            "n_far": sample.far,
            "wrong_basin_share": share,
            "wrong_basin_share_low": share_low,
            "wrong_basin_share_high": share_high,
            "no_basin": sample.no_basin,
            "n_used": n_used,
            "n_effective": sample.effective,
            **covariance,
            **pose_error_columns(sample),
            "warning": [
                remarks(
                    sample, method, n, covariance["floor_share"][clean], covariance["memory"][clean]
                )
                for n in n_used
            ],
        }
    )


def covariances_table(sample: Sample, reference: ArrayLike, method: Method) -> pd.DataFrame:
    """A row per setting: the covariance of the runs that its f is read off, without a floor.

    Of readings that are of no covariance, those that f would be if it were. Arguments as of
    `uncertainty_table`.
    """
    method = method.with_floor(0.0).of_covariances
    games = games_of_settings(sample, reference)
    row, column = np.triu_indices(6)
    found = covariances([sample], [games], -1, method)[:, row, column]
    return pd.DataFrame(
        {
            **dict(zip(sample.causes, sample.settings.T, strict=True)),
            "again": sample.again,
            "n_runs": sample.xi.shape[1],
            "n_used": kept_runs(sample, games, method).sum(axis=1),
            **dict(zip(COVARIANCE, found.T, strict=True)),
        }
    )


def games_of_settings(sample: Sample, reference: ArrayLike) -> np.ndarray:
    """A game (S, 2) of each setting: the clean one, at reference values (M,), and itself."""
    settings = np.arange(len(sample.settings))
    return np.column_stack([np.full_like(settings, sample.rows(reference)), settings])


def shap_table(
    replicates: list[Sample],
    instances: pd.DataFrame,
    rows: list[np.ndarray],
    off: Mapping[str, float],
    method: Method,
) -> pd.DataFrame:
    """A row per instance: f, Shapley values and interactions with intervals, and sensitivities.

    replicates: list of `Sample`; rows: of each, those (i, 2^M) of the settings of each instance's
    coalitions; off: reference value of each cause by name.
    """
    causes = list(replicates[0].causes)
    on = (instances[causes] != pd.Series(off)).to_numpy()
    found = explain_games(replicates, rows, method)
    shares = explain_shares(replicates, rows, on, method)
    if method.reading.counts_failed:
        found = replace(
            found,
            f=with_ends(found.f, shares.share.low, shares.share.high),
            phi=with_ends(found.phi, shares.phi.low, shares.phi.high),
            removal=with_ends(found.removal, shares.removal.low, shares.removal.high),
            interactions=with_ends(
                found.interactions, shares.interactions.low, shares.interactions.high
            ),
        )
    n_used = found.n_used.min(axis=0)
    f_again = float(np.mean([clean_again(sample, method) for sample in replicates]))
    variants = {
        "all": explain_games(replicates, rows, method, leave_out=False, intervals=False),
        "right_basin": explain_games(replicates, rows, method, leave_out=True, intervals=False),
        "floor_tenfold": explain_games(replicates, rows, method.with_floor(10.0), intervals=False),
        "floor_tenth": explain_games(replicates, rows, method.with_floor(0.1), intervals=False),
        "sensor_sigma_twice": _of_other_sensor(replicates, rows, method, 2.0),
        "sensor_sigma_half": _of_other_sensor(replicates, rows, method, 0.5),
    }
    n_right_basin = variants["right_basin"].n_used.min(axis=0)
    worth = independent(n_used, replicates[0], rows[0])
    null_mean, null_95 = null(worth, replicates[0], method)
    columns = {
        "base_value": found.base_value.value[:, 0],
        **columns_of(["f"], found.f),
        **_variant_columns(["f"], {kind: other.f for kind, other in variants.items()}),
        **_phi_columns(causes, found, variants),
        **columns_of(
            [f"interaction_{a}_{b}" for a, b in shapley.couples(causes)], found.interactions
        ),
        **columns_of([f"removal_{cause}" for cause in causes], found.removal),
        **_share_columns(causes, replicates, rows, shares),
        **shrinking_columns(replicates, rows, method),
        "regression_difference": _regression_difference(found),
        "f_again": f_again,
        "null_mean": null_mean,
        "null_95": null_95,
        "n_runs": sum(sample.xi.shape[1] for sample in replicates),
        "n_used": found.n_used.sum(axis=0),
        "n_effective": sum(
            sample.effective[row].min(axis=1) for sample, row in zip(replicates, rows, strict=True)
        ),
        "n_failed": _runs_anywhere([sample.failed for sample in replicates], rows),
        "n_wrong_basin": _runs_anywhere([sample.wrong_basin for sample in replicates], rows),
        "n_far": most_far(replicates, rows),
        "interval_over": "replicates" if len(replicates) > 1 else replicates[0].units,
        "no_interval": no_interval(replicates),
        "misfit": "",  # known where the fit table is
        "warning": remarks_of_games(replicates, rows, n_used, n_right_basin, f_again, method),
    }
    explained = instances[["instance", *causes]].reset_index(drop=True)
    return pd.concat([explained, pd.DataFrame(columns, index=explained.index)], axis=1)


def _of_other_sensor(replicates, rows, method, times):
    """`Explained` of games, had the sensor's own noise been `times` as large.

    NaN where the spread does not hold it, and for readings that are not of covariances.
    """
    found = [with_sensor_sigma(sample, times) for sample in replicates]
    others = [sample for sample in found if sample is not None]
    if not others or not method.reading.compares_with_clean:
        others = [Sample.without_runs(s.causes, s.settings, s.returns) for s in replicates]
    return explain_games(others, rows, method, intervals=False)


def _share_columns(causes, replicates, rows, shares):
    """W of the clean setting and the instance, and what each cause contributes to it."""
    lacking = [sample.no_basin[row] for sample, row in zip(replicates, rows, strict=True)]
    success = np.mean(
        [
            pose_error_columns(sample)["success_rate"][row[:, [0, -1]]]
            for sample, row in zip(replicates, rows, strict=True)
        ],
        axis=0,
    )
    return {
        "clean_success_rate": success[:, 0],
        "success_rate": success[:, 1],
        **columns_of(["clean_wrong_basin_share"], shares.clean),
        **columns_of(["wrong_basin_share"], shares.share),
        **columns_of([f"wrong_basin_{cause}" for cause in causes], shares.phi),
        **columns_of([f"wrong_basin_removal_{cause}" for cause in causes], shares.removal),
        "no_basin": np.any(lacking, axis=(0, 2)),
    }


def _variant_columns(names, variants):
    return {
        f"{name}_{kind}": other.value[:, q]
        for q, name in enumerate(names)
        for kind, other in variants.items()
    }


def _phi_columns(causes, found, variants):
    names = [f"phi_{cause}" for cause in causes]
    low, high = found.phi.low, found.phi.high
    columns = columns_of(names, found.phi)
    columns |= _variant_columns(names, {kind: other.phi for kind, other in variants.items()})
    for q, name in enumerate(names):
        columns[f"{name}_significant"] = (low[:, q] > 0) | (high[:, q] < 0)
        columns[f"{name}_draw_variance_ratio"] = found.phi.draw_variance_ratio[:, q]
    return columns


def _regression_difference(found):
    """Largest difference of phi to Algorithm 1's regression, relative to the largest |phi|."""
    largest = np.abs(found.phi.value).max(axis=1)
    difference = np.abs(found.regression.value - found.phi.value).max(axis=1)
    return difference / np.where(largest > 0, largest, 1.0)


def _runs_anywhere(marks, rows):
    """Runs (i) that are marked in at least one setting of a game, over all replicates."""
    return sum(mark[row].any(axis=1).sum(axis=1) for mark, row in zip(marks, rows, strict=True))


def resampled_values(
    runs: pd.DataFrame | None,
    estimates: pd.DataFrame | None,
    instances: pd.DataFrame,
    off: Mapping[str, float],
    returns: Returns,
    method: Method,
    pair: ScanPair,
    number: int = 200,
) -> pd.DataFrame:
    """Shapley values of bootstrap samples of a pair's runs: a row per instance and resample.

    Arguments as of `explain`. Whole noise draws are drawn again where there are several. Each
    resample is mirrored at the value of the shap table (basic bootstrap), so that the rows spread
    as the truth may; where nothing varies, they do not.
    """
    games = shapley.coalition_values(instances[list(off)], np.array(list(off.values())))
    mirrored = np.mean(
        [
            _mirrored(sample, sample.rows(games), method, number)
            for sample in samples(runs, estimates, off, returns, method, pair.characteristic_length)
        ],
        axis=0,
    )
    index = pd.MultiIndex.from_product(
        [instances["instance"], range(number)], names=["instance", "resample"]
    )
    table = pd.DataFrame(
        np.swapaxes(mirrored, 0, 1).reshape(-1, len(off)),
        index=index,
        columns=[f"phi_{name}" for name in off],
    ).reset_index()
    return _of_pair(pair, table)


def _mirrored(sample, rows, method, number):
    """Mirrored Shapley values (number, i, M) of games (i, 2^M), rows of a sample."""
    value = estimate(sample, rows, shapley.shapley_values, method, intervals=False).value
    result = np.full((number, *value.shape), np.nan)
    for members, plan, values in resampled(
        sample, rows, shapley.shapley_values, method, jackknife=False, bootstrap=number
    ):
        result[:, members] = value[members] + values[0] - values[plan.bootstrap]
    return result


def load_explanation(path: str | Path) -> shap.Explanation:
    """The shap.Explanation of a shap.parquet; see `shap_explanation`. Raises UserError as that."""
    return shap_explanation(pd.read_parquet(path), path)


def shap_explanation(table: pd.DataFrame, where: str | Path = "the table") -> shap.Explanation:
    """The shap.Explanation of a shap table: values, base values, data, names and bounds.

    Rows without a value (`reason` or `warning` says why) are left out. Raises UserError if the
    table, of which `where` tells, holds no Shapley values, or shap is not installed.
    """
    with extra("plots", "shap"):
        import shap

    names = [
        column.removeprefix("phi_").removesuffix("_low")
        for column in table
        if column.startswith("phi_") and column.endswith("_low")
    ]
    if not names:
        raise UserError(
            f"{where}: no column phi_<cause>_low.\n"
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
