"""What the numbers are where an estimator returns covariances, both, or samples that depend."""

from dataclasses import replace

import numpy as np
import pytest
from known_pair import PAIR
from known_runs import OFF, estimates_table, instances, runs_table, true_game

from icpshap.errors import UserError
from icpshap.estimators.kind import COVARIANCES, SAMPLES, Returns
from icpshap.explanation import doubts, games, readings, sample, shapley
from icpshap.explanation.method import Method
from icpshap.tables import COVARIANCE, XI

PHI = [f"phi_{name}" for name in OFF]
BOTH = Returns(samples=True, covariances=True, exchangeable=True)
DEPENDENT = Returns(samples=True, covariances=False)


def explain(runs, estimates, returns, full=False, **method):
    given = (runs, estimates, instances(full=full), OFF, returns, Method(**method), PAIR)
    return games.explain(*given)[:2]


def explain_one(*arguments, **method):
    return explain(*arguments, **method)[1].iloc[0]


NO_FLOOR = {"covariance_floor_rotation": 0.0, "covariance_floor_translation": 0.0}


class TestCovariancesAlone:
    def test_f_and_phi_are_those_of_the_covariances(self):
        row = explain_one(None, estimates_table(), COVARIANCES, **NO_FLOOR)
        assert row["f"] == pytest.approx(true_game()[-1])
        expected = shapley.shapley_values(true_game())
        np.testing.assert_allclose(row[PHI].astype(float), expected, rtol=1e-9)

    def test_one_noise_draw_gives_no_interval_and_says_why(self):
        row = explain_one(None, estimates_table(), COVARIANCES)
        assert np.isnan(row["f_low"]) and np.isnan(row["phi_sensor_noise_high"])
        assert not row["phi_sensor_noise_significant"]
        assert row["interval_over"] == ""
        assert row["no_interval"] == (
            "the estimator is deterministic, and there is one noise draw: nothing varies"
        )

    def test_several_draws_are_averaged_and_left_out_one_by_one(self):
        table = estimates_table(10, scale=lambda draw: 0.5 + 0.1 * draw)
        row = explain_one(None, table, COVARIANCES, **NO_FLOOR)
        # The same factor in every setting cancels in the KL divergence.
        assert row["f"] == pytest.approx(true_game()[-1])
        assert row["interval_over"] == "noise draws" and row["no_interval"] == ""
        assert row["f_low"] == pytest.approx(row["f_high"], rel=1e-9)
        factor = 1 + table["noise_draw"] / 20 * (table["sensor_noise"] > 0)
        table[COVARIANCE] = table[COVARIANCE].mul(factor, axis=0)
        row = explain_one(None, table, COVARIANCES, **NO_FLOOR)
        assert row["f_low"] < row["f"] < row["f_high"]
        assert np.isnan(row["phi_sensor_noise_draw_variance_ratio"])

    def test_the_scatter_of_the_estimates_is_not_added(self):
        table = estimates_table(4)
        clean, _ = explain(None, table, COVARIANCES, **NO_FLOOR)
        table[XI] *= 100
        far, _ = explain(None, table, COVARIANCES, **NO_FLOOR)
        np.testing.assert_array_equal(clean["logdet"], far["logdet"])
        assert (far["translation_rmse"] > 90 * clean["translation_rmse"]).all()

    def test_sigma_points_in_another_basin_are_counted_and_warned_of(self):
        table = estimates_table(2)
        table.loc[table["initial_pose"] > 1, "n_far"] = 2
        uncertainty, shap = explain(None, table, COVARIANCES)
        perturbed = uncertainty["initial_pose"] > 1
        assert (uncertainty["n_far"] == 2 * perturbed).all()
        row = shap.iloc[0]
        assert row["n_far"] == 2 and row["n_wrong_basin"] == 0
        assert "up to 2 of 12 sigma points of a setting end in another basin" in row["warning"]

    def test_a_deterministic_f_has_the_null_0_and_no_a_a_value(self):
        uncertainty, shap = explain(None, estimates_table(), COVARIANCES)
        assert (uncertainty[["null_mean", "null_95"]] == 0).all(axis=None)
        assert np.isnan(shap["f_again"].item())
        assert uncertainty["memory"].isna().all()
        assert (uncertainty["n_wrong_basin"] == 0).all()
        assert (uncertainty["warning"] == "").all()

    def test_a_draw_that_failed_is_left_out_of_all_settings(self):
        table = estimates_table(3, scale=lambda draw: 1.0 + draw)
        lost = (table["noise_draw"] == 2) & (table["sensor_noise"] > 0)
        table.loc[lost, "status"] = "degenerate"
        table.loc[lost, [*XI, *COVARIANCE]] = np.nan
        row = explain_one(None, table, COVARIANCES, **NO_FLOOR)
        assert (row["n_failed"], row["n_used"]) == (1, 2)
        assert row["f"] == pytest.approx(true_game()[-1])

    def test_nothing_left_gives_no_value_and_a_warning(self):
        table = estimates_table()
        table.loc[table["sensor_noise"] > 0, "status"] = "degenerate"
        row = explain_one(None, table, COVARIANCES)
        assert np.isnan(row["f"])
        assert row["warning"] == "only 0 noise draws left, fewer than 1: no value"

    def test_a_missing_draw_is_an_error(self):
        table = estimates_table(3)
        with pytest.raises(UserError, match=r"noise draws 0 to 2 once each[\s\S]*Hint"):
            explain(None, table.drop(index=4), COVARIANCES)


class TestBoth:
    def test_the_covariance_adds_to_that_of_the_samples(self):
        runs, table = runs_table(), estimates_table()
        (of_pair,) = sample.samples(runs, table, OFF, BOTH, Method(), 3.0)
        rows = np.arange(len(of_pair.settings))
        weights = np.ones((1, 100))
        found = of_pair.spread(rows, weights, Method()).covariance[:, 0]
        samples_alone = replace(of_pair, covariance=None).spread(rows, weights, Method())
        np.testing.assert_allclose(
            found, samples_alone.covariance[:, 0] + of_pair.covariance[:, 0], rtol=1e-12
        )

    def test_a_failed_covariance_takes_the_runs_of_its_draw_with_it(self):
        runs, table = runs_table(noise_draws=2), estimates_table(2)
        table.loc[(table["noise_draw"] == 1) & (table["sensor_noise"] > 0), "status"] = "degenerate"
        row = explain_one(runs, table, BOTH)
        assert (row["n_failed"], row["n_used"]) == (0, 50)
        assert row["wrong_basin_share"] == 0  # the runs did not fail

    def test_a_covariance_in_another_basin_than_the_runs_is_none(self):
        runs, table = runs_table(), estimates_table()
        table[XI] = 0.0
        there = explain_one(runs, table, BOTH)
        assert np.isfinite(there["f"])
        table.loc[table["sensor_noise"] > 0, "xi_3"] = 0.5
        row = explain_one(runs, table, BOTH)
        assert np.isnan(row["f"]) and row["n_used"] == 0
        assert "only 0 runs left (their covariance failed, or is that of another" in row["warning"]
        assert row["wrong_basin_share"] == there["wrong_basin_share"] == 0
        assert row["translation_rmse"] == there["translation_rmse"]

    def test_intervals_are_over_runs(self):
        row = explain_one(runs_table(), estimates_table(), BOTH)
        assert row["interval_over"] == "runs"
        assert row["f_low"] < row["f"] < row["f_high"]


class TestDependentSamples:
    def test_runs_are_not_left_out_one_by_one(self):
        row, independent = (explain_one(runs_table(), None, r) for r in (DEPENDENT, SAMPLES))
        assert row["f"] == independent["f"]
        assert np.isnan(row["f_low"]) and np.isnan(row["null_95"]) and np.isnan(row["f_again"])
        assert row["no_interval"] == (
            "the estimator's samples depend on one another, and there is one noise draw"
        )

    def test_several_noise_draws_give_an_interval(self):
        row, independent = (
            explain_one(runs_table(noise_draws=10), None, r) for r in (DEPENDENT, SAMPLES)
        )
        assert row["interval_over"] == "noise draws"
        for name in ("f_low", "f_high", "phi_sensor_noise_low"):
            assert row[name] == pytest.approx(independent[name], rel=1e-12)
        assert np.isnan(row["phi_sensor_noise_draw_variance_ratio"])

    def test_fewer_than_fifty_may_be_enough(self):
        row = explain_one(runs_table(n=20), None, DEPENDENT)
        assert np.isfinite(row["f"]) and row["warning"] == ""
        assert explain_one(runs_table(n=20), None, SAMPLES)["warning"].startswith("only 20 runs")


class TestWeights:
    def test_weights_count_as_repetitions_do(self):
        runs = runs_table(n=60)
        twice = runs["run"] < 20
        weighted = runs.assign(weight=np.where(twice, 2.0, 0.5))
        (of_pair,) = sample.samples(weighted, None, OFF, DEPENDENT, Method(), 3.0)
        found = of_pair.spread(3, np.ones((1, 60)), Method(**NO_FLOOR)).covariance[0]
        xi = of_pair.xi[3]
        expected = np.cov(xi.T, aweights=of_pair.weight, ddof=0) * 60 / 59
        np.testing.assert_allclose(found, expected, rtol=1e-9)

    def test_weights_that_differ_between_settings_are_refused(self):
        runs = runs_table(n=60)
        runs.loc[3, "weight"] = 2.0
        with pytest.raises(UserError, match=r"weights of the samples differ[\s\S]*Hint"):
            sample.samples(runs, None, OFF, DEPENDENT, Method(), 3.0)


def spread_of_runs(xi):
    of_runs = {**readings.run_numbers(xi, 3.0), "lost": xi[:, 0] > 1}
    return readings.Spread(xi, np.ones((1, 80)), (0.0, 0.0), of_runs=of_runs)


def test_what_a_reading_says_of_itself_is_so():
    """Compares with clean: f of a sample with itself is 0. Affine invariant: as A xi moves."""
    generator = np.random.default_rng(0)
    xi = generator.normal(size=(2, 80, 6)) * np.array([1.0, 1.5])[:, None, None]
    moved = xi @ generator.normal(size=(6, 6))
    for reading in readings.READINGS.values():
        one, other = ([spread_of_runs(x) for x in pair] for pair in (xi, moved))
        itself = reading.evaluate(one[0], one[0], False)
        assert np.allclose(itself, 0, atol=1e-9) == reading.compares_with_clean
        same = np.allclose(reading.evaluate(*one, False), reading.evaluate(*other, False))
        assert same == reading.affine_invariant
        assert np.isfinite(reading.null_factor) == reading.affine_invariant


def test_only_what_compares_with_clean_has_a_deterministic_null():
    (of_pair,) = sample.samples(None, estimates_table(), OFF, COVARIANCES, Method(), 3.0)
    method = Method(divergence="rotation_rmse")
    assert np.isnan(doubts.null(np.array([1]), of_pair, method)).all()


def test_the_states_of_a_chain_are_worth_fewer_samples_which_their_null_counts():
    """Of an autoregression with the factor 0.8, a ninth."""
    runs = runs_table(n=2000)
    generator = np.random.default_rng(1)
    chain = np.zeros((2000, 6))
    for step in range(1, 2000):
        chain[step] = 0.8 * chain[step - 1] + 0.6e-3 * generator.standard_normal(6)
    runs[XI] = np.tile(chain, (len(runs) // 2000, 1))
    returns = replace(DEPENDENT, chain=True)
    uncertainty, shap = explain(runs, None, returns)
    worth = uncertainty["n_effective"]
    assert worth.between(120, 300).all()
    expected = [readings.null_mean("kl", int(n)) for n in worth]
    np.testing.assert_allclose(uncertainty["null_mean"], expected)
    row = shap.iloc[0]
    assert row["n_effective"] == worth.min()
    assert row["null_mean"] == pytest.approx(readings.null_mean("kl", int(worth.min())))
    others, _ = explain(runs, None, DEPENDENT)
    assert others["n_effective"].isna().all() and others["null_mean"].isna().all()
