"""Shap tables with values that a test knows."""

import numpy as np
import pandas as pd

from icpshap import plan, tables
from icpshap.causes import NAMES, SOURCES
from icpshap.explanation import shapley
from icpshap.report import captions
from icpshap.tables import INITIAL_XI, XI

LEVELS = {
    "sensor_noise": (0.0, 0.05, 0.1),
    "initial_pose": (1.0, 1.5, 2.0),
    "partial_overlap": (0.0, 0.05),
}
FIXED = {"sensor_noise": (0.05,), "initial_pose": (1.5,), "partial_overlap": (0.05,)}
WATERFALL = {"sensor_noise": 0.1, "initial_pose": 1.5, "partial_overlap": 0.05}
STUDY = captions.Study(
    name="an_experiment",
    estimator="paper",
    divergence="kl",
    noise_draws=1,
    bias_correction="none",
    wrong_basins="keep",
    titles={"apartment": "Apartment", "eth": "ETH"},
    waterfall=WATERFALL,
)


def shap_table(levels=LEVELS, pairs=(("apartment", 6, 7),), seed=0):
    """A shap table with random f; intervals of half width 0.5 make small phi insignificant."""
    generator = np.random.default_rng(seed)
    instances = pd.DataFrame(plan.instances(levels), columns=list(NAMES))
    settings, games = np.unique(
        shapley.coalition_values(instances, [s.off for s in SOURCES]).reshape(-1, 3),
        axis=0,
        return_inverse=True,
    )
    clean = (settings == [s.off for s in SOURCES]).all(axis=1)
    parts = []
    for sequence, reference, source in pairs:
        f = np.where(clean, 0, generator.normal([[2.0]], 2.0, (1, len(settings)))[0])
        game = f[games.reshape(-1, 8)]
        table = instances.assign(sequence=sequence, reference=reference, source=source)
        table["instance"] = range(len(table))
        table["base_value"] = 0.0
        columns = {"f": game[:, -1]}
        for name, phi in zip(NAMES, shapley.shapley_values(game).T, strict=True):
            columns[f"phi_{name}"] = phi
        indices = shapley.interaction_indices(game).T
        for (a, b), index in zip(shapley.pairs(NAMES), indices, strict=True):
            columns[f"interaction_{a}_{b}"] = index
        for name, value in columns.items():
            half = 0.5 * (value != 0)
            table[name], table[f"{name}_low"], table[f"{name}_high"] = (
                value,
                value - half,
                value + half,
            )
            for variant in ("all", "right_basin", "floor_tenfold", "floor_tenth"):
                table[f"{name}_{variant}"] = value + 0.25
            table[f"{name}_significant"] = (value - half > 0) | (value + half < 0)
            table[f"{name}_draw_variance_ratio"] = np.nan
        parts.append(table)
    table = pd.concat(parts, ignore_index=True).assign(
        regression_difference=0.0,
        f_again=0.3,
        null_mean=0.228,
        null_95=0.368,
        n_runs=100,
        n_used=100,
        n_failed=0,
        n_wrong_basin=0,
        interval_over="runs",
        warning="",
        reason="",
    )
    return table[[column.name for column in tables.TABLES["shap"]]]


def without_value(table, rows, reason):
    """The table with rows as those of a pair that was not registered."""
    table = table.copy()
    numbers = [c for c in table if c.startswith(("f", "phi", "interaction", "null"))]
    for column in numbers:
        if table[column].dtype == float:
            table.loc[rows, column] = np.nan
        else:
            table.loc[rows, column] = False
    table.loc[rows, "reason"] = reason
    return table


def runs_table(settings, number=60):
    """Runs of some settings, as far as pictures need them; the first four in a wrong basin."""
    generator = np.random.default_rng(5)
    parts = []
    for values in settings:
        xi = generator.normal(0, [0.01, 0.02, 0.03, 0.1, 0.2, 0.3], (number, 6))
        part = pd.DataFrame(np.hstack([3 * xi, xi]), columns=INITIAL_XI + XI)
        parts.append(part.assign(**values, wrong_basin=np.arange(number) < 4))
    return pd.concat(parts, ignore_index=True).assign(draws=0, replicate=0)
