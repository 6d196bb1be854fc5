"""From runs to f: which runs count, what the covariance is worth, warnings."""

import numpy as np
import pytest
from known_runs import OFF, runs_table

from icpshap.errors import UserError
from icpshap.estimators.kind import SAMPLES
from icpshap.explanation import doubts, games, readings, sample, uncertainty
from icpshap.explanation.method import Method
from icpshap.tables import XI

NAMES = list(OFF)
REFERENCE = list(OFF.values())


def samples_of(runs, **method):
    return sample.samples(runs, None, NAMES, SAMPLES, Method(**method), 3.0)


def table_of(runs, **method):
    (of_pair,) = samples_of(runs, **method)
    return games.uncertainty_table(of_pair, REFERENCE, Method(**method))


def xi_of(runs, values, again=False):
    rows = (runs[NAMES] == values).all(axis=1) & (runs["again"] == again)
    return runs.loc[rows, XI].to_numpy()


def row_of(table, values, again=False):
    return table[(table[NAMES] == values).all(axis=1) & (table["again"] == again)].iloc[0]


def test_kl_is_that_of_the_sample_covariances():
    runs = runs_table()
    row = row_of(table_of(runs), [0.05, 1.5, 0.0])
    clean, perturbed = (
        readings.covariance(xi_of(runs, values), 1e-6, 1e-6)
        for values in (REFERENCE, [0.05, 1.5, 0.0])
    )
    assert row["kl"] == pytest.approx(readings.kullback_leibler(clean, perturbed))
    assert row["f"] == row["kl"]
    assert row["f_low"] <= row["f"] <= row["f_high"]
    assert row["logdet"] == pytest.approx(np.linalg.slogdet(perturbed)[1])
    assert row["condition"] == pytest.approx(np.linalg.cond(perturbed))
    deviations = np.sqrt(np.linalg.eigvalsh(perturbed))
    assert row["smallest_standard_deviation"] == pytest.approx(deviations[0])


@pytest.mark.parametrize("correction", ["none", "jackknife", "wishart"])
def test_the_clean_setting_has_no_uncertainty_of_its_own(correction):
    row = row_of(table_of(runs_table(), bias_correction=correction), REFERENCE)
    assert row[["f", "f_low", "f_high"]].tolist() == [0, 0, 0]


def test_the_order_of_the_rows_does_not_matter():
    runs = runs_table()
    shuffled = runs.sample(frac=1, random_state=0)
    assert table_of(shuffled).equals(table_of(runs))


def test_failed_runs_are_left_out_of_both_settings():
    runs = runs_table(failed=[(0, 4), (7, 5)])  # of the clean setting and of the last
    row = row_of(table_of(runs), [0.05, 1.5, 0.05])
    assert (row["n_runs"], row["n_failed"], row["n_used"]) == (100, 1, 98)
    kept = np.setdiff1d(np.arange(100), [4, 5])
    clean, perturbed = (
        readings.covariance(xi_of(runs, values)[kept], 1e-6, 1e-6)
        for values in (REFERENCE, [0.05, 1.5, 0.05])
    )
    assert row["f"] == pytest.approx(readings.kullback_leibler(clean, perturbed))
    assert row["success_rate"] == pytest.approx(0.99)


def test_wrong_basins_are_counted_and_left_out_if_the_method_says_so():
    runs = runs_table(wrong=[3, 60])
    kept = row_of(table_of(runs), [0.05, 1.0, 0.0])
    left_out = row_of(table_of(runs, wrong_basins="leave_out"), [0.05, 1.0, 0.0])
    assert (kept["n_wrong_basin"], kept["n_used"], left_out["n_used"]) == (2, 100, 98)
    assert kept["condition"] > 20 * left_out["condition"]
    assert kept["success_rate"] == pytest.approx(0.98)


def test_fewer_than_fifty_runs_give_no_value_and_a_warning():
    runs = runs_table(failed=[(7, run) for run in range(51)])
    row = row_of(table_of(runs), [0.05, 1.5, 0.05])
    assert row[["f", "f_low", "kl", "null_95", "logdet"]].isna().all()
    assert row["warning"] == "only 49 runs left, fewer than 50: no value"
    assert row_of(table_of(runs), [0.05, 1.5, 0.0])["n_used"] == 100


def test_errors_are_about_the_ground_truth():
    runs = runs_table()
    runs[XI] += [0.0, 0.01, 0.0, 0.0, 0.0, 0.0]
    row = row_of(table_of(runs), REFERENCE)
    rotation = np.linalg.norm(xi_of(runs, REFERENCE)[:, :3], axis=1)
    assert row["mean_rotation_error"] == pytest.approx(rotation.mean())
    assert row["rotation_rmse"] == pytest.approx(np.sqrt((rotation**2).mean()))


def test_bias_corrections():
    """Of two independent clean samples: f is about 0.23 as it comes, and 0 once corrected."""
    clean = {name: [off] for name, off in OFF.items()}
    found = {"none": [], "jackknife": [], "wishart": []}
    for seed in range(20):
        (of_pair,) = samples_of(runs_table(seed, levels=clean))
        for correction, values in found.items():
            values.append(doubts.clean_again(of_pair, Method(bias_correction=correction)))
    assert np.mean(found["none"]) == pytest.approx(0.228, abs=0.05)
    assert np.mean(found["jackknife"]) == pytest.approx(0.0, abs=0.05)
    assert np.mean(found["wishart"]) == pytest.approx(0.0, abs=0.05)


def test_an_interval_is_widened_to_hold_a_value_beside_it():
    """f of independent clean samples is biased upwards, out of the interval of the truth."""
    clean = {name: [off] for name, off in OFF.items()}
    (of_pair,) = samples_of(runs_table(levels=clean))

    def both_signs(game):
        return game[..., 1:] * np.array([1.0, -1.0])

    found = uncertainty.estimate(of_pair, np.array([[0, 1]]), both_signs, Method())
    f = found.value[0, 0]
    assert found.high[0].tolist() == [f, -found.low[0, 0]]
    assert found.low[0, 1] == -f


def test_jackknife_correction_deletes_runs():
    runs = runs_table()
    row = row_of(table_of(runs, bias_correction="jackknife"), [0.05, 1.0, 0.0])
    xi = np.stack([xi_of(runs, values) for values in (REFERENCE, [0.05, 1.0, 0.0])])

    def f(xi):
        return readings.kullback_leibler(*readings.covariance(xi, 1e-6, 1e-6))

    left_out = np.mean([f(np.delete(xi, run, axis=1)) for run in range(100)])
    assert row["f"] == pytest.approx(100 * f(xi) - 99 * left_out)
    assert row["f"] == pytest.approx((row["f_low"] + row["f_high"]) / 2)


def test_null_columns_are_those_of_the_runs_in_use():
    runs = runs_table(failed=[(7, 5)])
    table = table_of(runs)
    assert row_of(table, [0.05, 1.5, 0.05])["null_mean"] == readings.null_mean("kl", 99)
    assert row_of(table, REFERENCE)["null_95"] == readings.null_quantile("kl", 100, 0.95)
    assert table_of(runs, divergence="rotation_rmse")["null_mean"].isna().all()


def test_clean_again_compares_independent_clean_samples():
    runs = runs_table()
    (of_pair,) = samples_of(runs)
    clean, again = (
        readings.covariance(xi_of(runs, REFERENCE, again), 1e-6, 1e-6) for again in (False, True)
    )
    expected = readings.kullback_leibler(clean, again)
    assert doubts.clean_again(of_pair, Method()) == pytest.approx(expected)
    (without,) = samples_of(runs[~runs["again"]])
    assert np.isnan(doubts.clean_again(without, Method()))


def test_memory_is_the_share_that_follows_the_initial_pose():
    generator = np.random.default_rng(0)
    initial = generator.normal(size=(4000, 6))
    xi = generator.normal(size=(4000, 6))
    assert doubts.memory(initial, xi) < 0.01
    xi[:, 4] += 2.0 * initial[:, 1]
    assert doubts.memory(initial, xi) == pytest.approx(0.8, abs=0.02)
    assert doubts.memory(initial, np.zeros((4000, 6))) == 0
    assert np.isnan(doubts.memory(initial[:13], xi[:13]))


def test_runs_in_a_wrong_basin_have_no_say_in_the_memory():
    """They come from far-off initial poses, but that is no sign of the stopping rule."""
    runs = runs_table(wrong=[3, 60])
    runs.loc[runs["run"].isin([3, 60]), "initial_xi_0"] = 5.0
    assert row_of(table_of(runs), REFERENCE)["memory"] < 0.3


def test_a_singular_covariance_without_a_floor_is_an_error():
    runs = runs_table().assign(xi_2=0.01)
    with pytest.raises(UserError, match=r"singular: .*\n.*or set covariance_floor_rotation"):
        table_of(runs, covariance_floor_rotation=0.0, covariance_floor_translation=0.0)
    assert table_of(runs)["f"].notna().all()


def test_a_clean_covariance_made_by_the_floor_or_the_stopping_rule_is_named():
    runs = runs_table()
    assert (table_of(runs)["warning"] == "").all()
    table = table_of(runs, covariance_floor_rotation=1e-3, covariance_floor_translation=1e-3)
    assert table["floor_share"].between(0, 1).all()
    assert table["warning"].str.fullmatch("the floor makes up 6.% of the clean .* direction").all()
    runs.loc[(runs[NAMES] == REFERENCE).all(axis=1), "initial_xi_2"] = runs["xi_3"]
    warning = table_of(runs)["warning"]
    assert warning.str.contains("initial pose explains 100% .* where the iteration stops").all()


def test_settings_must_have_the_same_runs():
    runs = runs_table()
    with pytest.raises(UserError, match=r"1 of 9 settings .* runs 0 to 99 .*\nHint: a file"):
        samples_of(runs.drop(index=250))
    with pytest.raises(UserError, match="sensor_noise"):
        samples_of(runs.drop(index=range(400, 450)))


def test_a_setting_that_was_not_run_is_named():
    (of_pair,) = samples_of(runs_table())
    with pytest.raises(UserError, match=r"1 settings have no runs, the first is sensor_noise 0.07"):
        of_pair.rows([[0.07, 1.0, 0.0], [0.05, 1.0, 0.0]])
    assert of_pair.rows([0.05, 1.0, 0.0]) == list(map(tuple, of_pair.settings)).index((0.05, 1, 0))


def test_a_failed_run_does_not_decide_which_basin_is_wrong():
    runs = runs_table()
    table = runs[(runs[NAMES] == REFERENCE).all(axis=1) & ~runs["again"]].reset_index(drop=True)
    failed = table.index < 60
    table[XI] = np.where(failed[:, None], table[XI] + 5.0, table[XI])
    table["status"] = np.where(failed, "too_few_links", "ok")
    assert not sample.mark_wrong_basins(table, Method(), 3.0).any()


def test_the_limits_of_a_basin_are_the_methods():
    runs = runs_table(wrong=[3, 60])
    row = row_of(table_of(runs, wrong_basin_translation=9.0, wrong_basin_rotation=90.0), REFERENCE)
    assert row["n_wrong_basin"] == 0
