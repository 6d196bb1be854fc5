"""What each cause contributes: properties of the tables, and coverage of a known truth."""

import time

import matplotlib
import numpy as np
import pandas as pd
import pytest
import shap
from known_pair import PAIR
from known_runs import LEVELS, OFF, instances, runs_table, true_game

from icpshap import causes, tables
from icpshap.errors import UserError
from icpshap.estimators.kind import SAMPLES
from icpshap.explanation import games, shapley
from icpshap.explanation.method import Method

matplotlib.use("Agg")
PHI = [f"phi_{name}" for name in OFF]


def explain(runs, full=False, levels=LEVELS, **method):
    given = (runs, None, instances(levels, full), OFF, SAMPLES, Method(**method), PAIR)
    return games.explain(*given)[:2]


def explain_one(runs, **method):
    return explain(runs, **method)[1].iloc[0]


def test_columns_are_those_of_the_tables():
    given = (runs_table(), None, instances(), OFF, SAMPLES, Method(), PAIR)
    for name, found in games.explain(*given)._asdict().items():
        columns = tables.columns(name, causes.named(OFF))
        assert set(found) == {column.name for column in columns}


def test_values_are_the_shapley_values_of_the_settings():
    uncertainty, table = explain(runs_table())
    row = table.iloc[0]
    f = uncertainty[~uncertainty["again"]].set_index(list(OFF))["f"]
    settings = shapley.coalition_values(instances()[list(OFF)], list(OFF.values()))[0]
    game = np.array([f.loc[tuple(setting)] for setting in settings])
    np.testing.assert_allclose(row[PHI].astype(float), shapley.shapley_values(game))
    assert row["f"] == pytest.approx(f.loc[0.05, 1.5, 0.05])
    assert row["interaction_initial_pose_partial_overlap"] == pytest.approx(
        shapley.interaction_indices(game)[2]
    )
    assert row["f_again"] == uncertainty.loc[uncertainty["again"], "f"].item()


def test_base_value_and_phi_add_up_to_f():
    for divergence in ("kl", "rotation_rmse"):
        _, table = explain(runs_table(), full=True, divergence=divergence)
        total = table["base_value"] + table[PHI].sum(axis=1)
        np.testing.assert_allclose(total, table["f"], rtol=1e-12)
        assert (table["base_value"].abs() > 1e-6).all() == (divergence == "rotation_rmse")


def test_a_cause_at_its_reference_value_contributes_exactly_nothing():
    _, table = explain(runs_table(), full=True)
    off = table[table["sensor_noise"] == 0]
    columns = ["phi_sensor_noise", "phi_sensor_noise_low", "phi_sensor_noise_high"]
    assert (off[columns] == 0).all(axis=None)
    assert not off["phi_sensor_noise_significant"].any()
    assert (off["interaction_sensor_noise_partial_overlap"] == 0).all()


def test_regression_agrees_with_the_exact_values():
    _, table = explain(runs_table(), full=True, bias_correction="jackknife")
    assert table["regression_difference"].max() < 1e-5


def test_significance_is_an_interval_without_zero():
    _, table = explain(runs_table(), full=True)
    for phi in PHI:
        excludes_zero = (table[f"{phi}_low"] > 0) | (table[f"{phi}_high"] < 0)
        assert (table[f"{phi}_significant"] == excludes_zero).all()
    assert table.iloc[-1]["phi_sensor_noise_significant"]


def test_values_with_and_without_wrong_basins_stand_side_by_side():
    runs = runs_table(wrong=[3, 60])
    without = runs[~runs["run"].isin([3, 60])].assign(run=lambda t: t.groupby("run").ngroup())
    kept, left_out = explain_one(runs), explain_one(runs, wrong_basins="leave_out")
    expected = explain_one(without)
    for name in ("f", *PHI):
        assert [kept[f"{name}_all"], left_out[f"{name}_all"]] == pytest.approx([kept[name]] * 2)
        without_basins = [kept[f"{name}_right_basin"], left_out[f"{name}_right_basin"]]
        assert without_basins == pytest.approx([left_out[name]] * 2)
        assert left_out[name] == pytest.approx(expected[name])
    assert abs(kept["f"] - left_out["f"]) > 0.2
    assert (kept["n_wrong_basin"], left_out["n_used"]) == (2, 98)


def test_runs_that_failed_in_one_setting_are_left_out_of_the_game():
    failed = [(1, 4), (6, 5)]
    runs = runs_table(failed=failed)
    row = explain_one(runs)
    assert (row["n_failed"], row["n_used"]) == (2, 98)
    rest = runs[~runs["run"].isin([4, 5])].assign(run=lambda t: t.groupby("run").ngroup())
    assert row["phi_sensor_noise"] == pytest.approx(explain_one(rest)["phi_sensor_noise"])


def test_fewer_than_fifty_runs_are_not_explained():
    row = explain_one(runs_table(failed=[(1, run) for run in range(60)]))
    assert row[[*PHI, "f", "null_95"]].isna().all()
    assert not row["phi_sensor_noise_significant"]
    assert row["warning"] == "only 40 runs left, fewer than 50: no value"


def test_clean_samples_that_differ_more_than_gaussian_ones_are_named():
    runs = runs_table()
    assert explain_one(runs)["warning"] == ""
    far = runs["again"] & (runs["run"] == 7)
    runs.loc[far, "xi_3"] += 1.0
    row = explain_one(runs)
    assert row["f_again"] > row["null_95"]
    assert row["warning"].startswith("two clean samples differ by")


def test_too_few_runs_outside_wrong_basins_are_named():
    runs = runs_table()
    runs.loc[runs["run"] < 30 + 25 * (runs["sensor_noise"] > 0), "xi_3"] += 0.5
    row = explain_one(runs)
    assert row["n_used"] == 100
    assert np.isnan(row["f_right_basin"])
    assert row["warning"] == "fewer than 50 runs are never in a wrong basin: no value without those"


def test_floor_variants_are_the_values_with_another_floor():
    runs = runs_table()
    row = explain_one(runs, covariance_floor_rotation=1e-4, covariance_floor_translation=1e-3)
    tenfold = explain_one(runs, covariance_floor_rotation=1e-3, covariance_floor_translation=1e-2)
    assert row["phi_sensor_noise_floor_tenfold"] == pytest.approx(tenfold["phi_sensor_noise"])
    assert tenfold["f_floor_tenth"] == pytest.approx(row["f"])


def test_replicates_give_the_mean_and_its_interval():
    runs = runs_table(replicates=4)
    uncertainty, table = explain(runs)
    single = [
        explain_one(part.assign(replicate=0)) for _, part in runs.groupby("replicate", sort=True)
    ]
    values = np.array([row["phi_sensor_noise"] for row in single])
    row = table.iloc[0]
    half = 3.182446 * values.std(ddof=1) / 2  # Student's t, 3 degrees of freedom
    assert row["phi_sensor_noise"] == pytest.approx(values.mean())
    assert row["phi_sensor_noise_low"] == pytest.approx(values.mean() - half)
    assert row["interval_over"] == "replicates"
    assert row["n_runs"] == row["n_used"] == 400
    assert row["null_mean"] == pytest.approx(42 / 184)
    assert uncertainty["replicate"].value_counts().to_dict() == dict.fromkeys(range(4), 9)


def test_interval_over():
    assert explain_one(runs_table())["interval_over"] == "runs"
    assert explain_one(runs_table(noise_draws=10))["interval_over"] == "noise draws"


def test_a_pair_that_was_not_registered_stays_in_the_tables_with_its_reason():
    given = (None, None, instances(full=True), OFF, SAMPLES, Method(), PAIR, "no overlap")
    found = games.explain(*given)
    values = ("f", "f", "value", "covariance_00")
    for table, rows, value in zip(found, (8, 8, 88, 8), values, strict=True):
        assert len(table) == rows
        assert table[value].isna().all()
        assert (table["reason"] == "no overlap").all()
        assert set(table[list(PAIR.columns)].itertuples(index=False, name=None)) == {("room", 0, 1)}


def test_intervals_hold_the_truth_at_the_nominal_rate():
    repetitions = 60
    truth = shapley.shapley_values(true_game())
    inside = np.zeros(3)
    for seed in range(repetitions):
        row = explain_one(runs_table(seed))
        low, high = (row[[f"{phi}_{end}" for phi in PHI]].to_numpy() for end in ("low", "high"))
        inside += (low <= truth) & (truth <= high)
    assert (inside >= 51).all()  # a binomial's 0.3 % quantile at 0.95
    assert (inside < repetitions).any()


def test_interactions_of_additive_variances():
    """f is not additive even when variances are: two causes that widen the same direction."""
    variances = 1.0 + shapley.coalitions(2).astype(float) @ [9.0, 9.0]
    game = (1 / variances - 1 + np.log(variances)) / 2
    assert shapley.interaction_indices(game)[0] == pytest.approx(-0.4040, abs=1e-4)


def test_resampled_values_spread_about_the_value_as_the_interval_does():
    runs = runs_table()
    given = (runs, None, instances(), OFF, SAMPLES, Method(), PAIR)
    resampled = games.resampled_values(*given, number=2000)
    row = explain_one(runs, interval="bootstrap")
    ends = resampled["phi_partial_overlap"].quantile([0.025, 0.975]).to_numpy()
    expected = row[["phi_partial_overlap_low", "phi_partial_overlap_high"]].to_numpy(dtype=float)
    np.testing.assert_allclose(ends, expected, atol=0.1 * np.ptp(expected))
    assert resampled.columns.tolist()[:5] == [*PAIR.columns, "instance", "resample"]


def test_a_grid_is_explained_in_proportion_to_ten_seconds_for_the_papers():
    levels = {name: np.linspace(*ends, 6) for name, ends in LEVELS.items()}
    runs = runs_table(levels=levels)
    start = time.process_time()
    _, table = explain(runs, full=True, levels=levels)
    assert time.process_time() - start < 10 * len(table) / 1331


def test_load_explanation_serves_the_plots_of_shap(tmp_path):
    _, table = explain(runs_table(), full=True)
    given = (None, None, instances(), OFF, SAMPLES, Method(), PAIR, "no overlap")
    lost = games.explain(*given).shap
    both = pd.concat([table, lost], ignore_index=True)
    tables.write(tmp_path / "shap.parquet", both, "shap", causes=OFF)
    loaded = games.load_explanation(tmp_path / "shap.parquet")
    np.testing.assert_array_equal(loaded.values, table[PHI])
    np.testing.assert_array_equal(loaded.lower_bounds, table[[f"{phi}_low" for phi in PHI]])
    np.testing.assert_array_equal(loaded.base_values, table["base_value"])
    np.testing.assert_array_equal(loaded.data, table[list(OFF)])
    assert loaded.feature_names == list(OFF)
    shap.plots.waterfall(loaded[-1], show=False)
    shap.plots.beeswarm(loaded, show=False)
    shap.plots.scatter(loaded[:, "sensor_noise"], color=loaded, show=False)
    shap.plots.bar(loaded, show=False)
    matplotlib.pyplot.close("all")


def test_load_explanation_says_which_file_it_wants(tmp_path):
    path = tmp_path / "uncertainty.parquet"
    pd.DataFrame({"f": [1.0]}).to_parquet(path)
    with pytest.raises(UserError, match=r"uncertainty.parquet: no column phi_.*\nHint: .*shap"):
        games.load_explanation(path)
