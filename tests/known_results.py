"""Shap tables with values that a test knows, for any causes and estimators."""

import itertools
from contextlib import contextmanager
from dataclasses import dataclass
from typing import ClassVar

import known_pair
import known_runs
import numpy as np
import pandas as pd

from icpshap import causes, estimators, tables
from icpshap.causes.cause import Cause
from icpshap.data.pair import Pair
from icpshap.estimators.kind import COVARIANCES, SAMPLES, Kind, Returns
from icpshap.explanation import games, shapley
from icpshap.explanation.method import Method
from icpshap.fit import checks
from icpshap.report.study import PAIR, Study, pairs_of
from icpshap.tables import INITIAL_XI, XI

THREE = ("sensor_noise", "initial_pose", "partial_overlap")
LEVELS = {
    "sensor_noise": (0.0, 0.05, 0.1),
    "initial_pose": (1.0, 1.5, 2.0),
    "partial_overlap": (0.0, 0.05),
}
FIXED = {"sensor_noise": (0.05,), "initial_pose": (1.5,), "partial_overlap": (0.05,)}
PAIRS = (("apartment", 0, 1), ("apartment", 1, 2), ("eth", 0, 1))
WATERFALL = {"sensor_noise": 0.1, "initial_pose": 1.5, "partial_overlap": 0.05}
STUDY = Study(
    name="an_experiment",
    estimator="paper",
    kind="monte_carlo",
    causes=THREE,
    divergence="kl",
    noise_draws=1,
    bias_correction="none",
    wrong_basins="keep",
    dependence=(
        ("sensor_noise", "initial_pose"),
        ("initial_pose", "partial_overlap"),
        ("partial_overlap", "initial_pose"),
    ),
    titles={"apartment": "Apartment", "eth": "ETH"},
    waterfall=WATERFALL,
)

# --- other causes and estimators ------------------------------------------------------------------


class Moves:
    def move(self, points, scan, level, draw, streams):
        return points + level


class Removes:
    def keep(self, pair, scan, level, draw, streams):
        return np.arange(len(getattr(pair, scan))) >= level


def cause(name, title, symbol, unit, off, colour, hook, order):
    words = {"title": title, "symbol": symbol, "unit": unit, "off": off, "colour": colour}
    return type(name, (hook, Cause), words | {"name": name, "order": order, "meaning": title})


# Names that hold what joins two of them in the name of a figure, long titles, long symbols.
EXTRA = (
    cause("error_by_range", "error by range", "c_r", "1/m", 0.0, "#CC79A7", Moves, 40),
    cause("under_constrained", "under-constrained scene", "u", "", 0.0, "#56B4E9", Removes, 50),
    cause("motion", "motion distortion", "d", "m/scan", 0.0, "#E69F00", Moves, 60),
    cause("error", "miscalibration", "Δα", "deg", 1.0, "#999933", Moves, 70),
)
SEVEN = (*THREE, *(extra.name for extra in EXTRA))
OF_NUMBER = {1: THREE[:1], 2: THREE[:2], 3: THREE, 5: SEVEN[:5], 7: SEVEN}
ALL_LEVELS = LEVELS | {
    "error_by_range": (0.0, 0.02),
    "under_constrained": (0.0, 0.9),
    "motion": (0.0, 0.125),
    "error": (1.0, 2.5),
}


@dataclass(frozen=True)
class ClosedForm(Kind):
    name: ClassVar = "closed_form"
    returns: ClassVar = COVARIANCES


@dataclass(frozen=True)
class Particles(Kind):
    name: ClassVar = "particles"
    returns: ClassVar = Returns(samples=True, covariances=False)


@contextmanager
def plugged_in():
    """The registries with the causes and kinds of this file in them, restored afterwards."""
    known = [(causes.CAUSES, EXTRA), (estimators.KINDS, (ClosedForm, Particles))]
    before = [dict(registry) for registry, _ in known]
    try:
        for registry, members in known:
            registry.update({member.name: member for member in members})
        yield
    finally:
        for (registry, _), members in zip(known, before, strict=True):
            registry.clear()
            registry.update(members)


def study_of(names, **changes):
    """A study of the causes of these names; it shows every couple of neighbours."""
    known = {name: ALL_LEVELS[name][-1] for name in names}
    fields = {
        "causes": tuple(names),
        "dependence": tuple(itertools.pairwise(names)),
        "waterfall": {name: WATERFALL.get(name, level) for name, level in known.items()},
    }
    return Study(**STUDY.__dict__ | fields | changes)


def grid_of(names):
    """A shap table over all levels of these causes."""
    return shap_table({name: ALL_LEVELS[name] for name in names})


def fixed_of(names, pairs=PAIRS):
    """A shap table of several pairs in which every one of these causes is on."""
    return shap_table({name: ALL_LEVELS[name][-1:] for name in names}, pairs)


# --- tables ---------------------------------------------------------------------------------------


def shap_table(levels=LEVELS, pairs=(("apartment", 6, 7),), seed=0):
    """A shap table with random f; intervals of half width 0.5 make small phi insignificant.

    levels: cause and its values, for each cause of the experiment.
    """
    off = [causes.CAUSES[name].off for name in levels]
    instances = pd.DataFrame(itertools.product(*levels.values()), columns=list(levels))
    games = shapley.coalition_values(instances, off)
    settings, games = np.unique(games.reshape(-1, len(off)), axis=0, return_inverse=True)
    games = games.reshape(len(instances), -1)
    clean = (settings == off).all(axis=1)
    generator = np.random.default_rng(seed)
    parts = []
    for sequence, reference, source in pairs:
        f = np.where(clean, 0, generator.normal([[2.0]], 2.0, (1, len(settings)))[0])
        pair = {"sequence": sequence, "reference": reference, "source": source}
        numbers = pair | {"instance": range(len(instances))} | _numbers(f[games], list(levels))
        parts.append(pd.concat([instances, pd.DataFrame(numbers)], axis=1))
    table = pd.concat(parts, ignore_index=True).assign(
        base_value=0.0,
        regression_difference=0.0,
        f_again=0.3,
        null_mean=0.228,
        null_95=0.368,
        n_runs=100,
        n_used=100,
        n_effective=100.0,
        n_failed=0,
        n_wrong_basin=0,
        n_far=0,
        clean_success_rate=1.0,
        success_rate=0.97,
        clean_wrong_basin_share=0.01,
        clean_wrong_basin_share_low=0.002,
        clean_wrong_basin_share_high=0.05,
        wrong_basin_share=0.03,
        wrong_basin_share_low=0.01,
        wrong_basin_share_high=0.08,
        no_basin=False,
        clean_translation_rmse=0.02,
        translation_rmse=0.05,
        clean_rotation_rmse=0.01,
        rotation_rmse=0.02,
        interval_over="runs",
        no_interval="",
        misfit="",
        warning="",
        reason="",
    )
    return table[[column.name for column in tables.columns("shap", causes.named(levels))]]


def _numbers(game, names):
    """Columns of all that is read off games (i, 2^M)."""
    couples = shapley.couples(names) if len(names) > 1 else []
    indices = shapley.interaction_indices(game).T if couples else []
    values = {"f": game[:, -1]}
    values |= dict(zip([f"phi_{n}" for n in names], shapley.shapley_values(game).T, strict=True))
    values |= {f"interaction_{a}_{b}": i for (a, b), i in zip(couples, indices, strict=True)}
    on = dict(zip(names, shapley.removal_effects(game).T, strict=True))
    columns = {"shrinks": False}
    for name, value in on.items():
        for what, number in (
            ("removal", value),
            ("wrong_basin", 0.01 * value),
            ("wrong_basin_removal", 0.01 * value),
            ("entropy_difference", np.abs(value)),
        ):
            half = 0.5 * np.abs(number)
            found = {"": number, "_low": number - half, "_high": number + half}
            columns |= {f"{what}_{name}{end}": part for end, part in found.items()}
        columns[f"narrows_{name}"] = False
    columns |= {f"entropy_difference{end}": 2.0 for end in ("", "_low", "_high")}
    for name, value in values.items():
        half = 0.5 * (value != 0)
        columns |= {name: value, f"{name}_low": value - half, f"{name}_high": value + half}
        variants = ("all", "right_basin", "floor_tenfold", "floor_tenth")
        variants += ("sensor_sigma_twice", "sensor_sigma_half")
        columns |= {f"{name}_{variant}": value + 0.25 for variant in variants}
        columns[f"{name}_significant"] = (value - half > 0) | (value + half < 0)
        columns[f"{name}_draw_variance_ratio"] = np.nan
    return columns


def directions_table():
    """The directions of the one instance of `known_runs`, as they are explained."""
    given = (known_runs.runs_table(), None, known_runs.instances(), known_runs.OFF, SAMPLES)
    return games.explain(*given, Method(), known_pair.PAIR).directions


def of_covariances(table, noise_draws=1):
    """The table as an estimator makes it that returns a covariance from each noise draw."""
    table = table.assign(n_runs=noise_draws, n_used=noise_draws, f_again=np.nan)
    table = table.assign(null_mean=0.0, null_95=0.0, interval_over="noise draws")
    table[[c for c in table if "wrong_basin" in c and table[c].dtype == float]] = np.nan
    if noise_draws > 1:
        return table
    reason = "the estimator is deterministic, and there is one noise draw: nothing varies"
    return without_intervals(table, reason)


def without_intervals(table, reason):
    """The table of an experiment whose numbers have no interval."""
    table = table.assign(interval_over="", no_interval=reason)
    table[[c for c in table if c.endswith(("_low", "_high"))]] = np.nan
    table[[c for c in table if c.endswith("_significant")]] = False
    return table


def without_value(table, rows, reason):
    """The table with rows as those of a pair that was not registered."""
    table = table.copy()
    numbers = [c for c in table if c.startswith(("f", "phi", "interaction", "null"))]
    for column in numbers:
        if table[column].dtype == float:
            table.loc[rows, column] = np.nan
        else:
            table.loc[rows, column] = False
    table.loc[rows, ["interval_over", "reason"]] = ["", reason]
    return table


def ranking_row(sequence, rule="iqr", causes=THREE, **changes):
    """A row of a ranking table; the medians of the first three causes are 8.0, 0.1 and 2.0."""
    row = {"sequence": sequence, "outlier_rule": rule, "n_pairs": 5, "n_rows": 5, "n_removed": 1}
    for name, value in zip(causes, itertools.cycle((8.0, 0.1, 2.0)), strict=False):
        row |= {
            f"median_{name}": value,
            f"median_{name}_low": value - 0.5,
            f"median_{name}_high": value + 0.5,
            f"paper_{name}": np.nan,
            f"paper_{name}_inside": False,
        }
    row |= {"order": "sensor_noise > partial_overlap > initial_pose", "warning": ""}
    return row | {"probability": 0.98, "p": 0.01, "p_holm": 0.02} | changes


def ranking(*rows):
    return pd.DataFrame(rows)


# What a row says where the paper has a value of sensor noise.
PRINTED = {"paper_sensor_noise": 7.9, "paper_sensor_noise_inside": True}


def runs_table(settings, number=60):
    """Runs of some settings, as far as pictures need them; the first four in a wrong basin."""
    generator = np.random.default_rng(5)
    parts = []
    for values in settings:
        xi = generator.normal(0, [0.001, 0.002, 0.003, 0.003, 0.006, 0.01], (number, 6))
        initial = pd.DataFrame(30 * xi, columns=INITIAL_XI)
        xi[:4, 3:] += [1.0, 2.0, 3.0]
        part = initial.join(pd.DataFrame(xi, columns=XI))
        parts.append(part.assign(**values, run=range(number), status="ok", weight=1.0))
    return pd.concat(parts, ignore_index=True).assign(again=False, replicate=0)


def pair_of_scans(points=3000):
    """A `Pair` of two clouds of the corner of a room, overlapping in part."""
    generator = np.random.default_rng(3)

    def cloud(least):
        found = generator.uniform([least, 1.5, 1.2], [5.0, 4.0, 3.5], (points, 3))
        wall = generator.integers(0, 3, points)
        found[np.arange(points), wall] = np.array([5.0, 4.0, 3.5])[wall]
        return found

    return Pair.measured(cloud(1.5), cloud(0.5), np.eye(4), 0.2)


def fit_numbers(pairs, **changed):
    """A fit_numbers table of pairs (rows of any table) that all fits, but for what is changed."""
    numbers = {
        "minimum_range": 1.0,
        "voxel_size": np.nan,
        "subsampling_probability": 0.05,
        "stop_rotation": 1e-3,
        "neighbours": 7.0,
        "normal_radius": 0.06,
        "line_share": 0.0,
        "ring_share": 0.01,
        "mending_voxel": np.nan,
        "mending_neighbours": np.nan,
        "largest_noise": 0.05,
        "source_points": 1800.0,
        "reference_points": 36_000.0,
        "overlap": 0.9,
        "overlap_distance": 0.2,
        "matched_distance": 0.05,
        "duplicate_share": 0.0,
        "nearest_return": 0.2,
        "typical_range": 2.5,
        "removed_share": 0.05,
        "motion": 0.5,
        "median_distance": 0.03,
        "better_pose": "",
    }
    table = pairs_of(pairs)[PAIR].reset_index(drop=True)
    return table.assign(**{**numbers, **changed})


def fit_table(pairs, **changed):
    """The fit table of the same."""
    return checks.table(fit_numbers(pairs, **changed))
