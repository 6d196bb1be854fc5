"""Variances by direction: additive games in the reference's axes, and the growth of the error."""

import numpy as np
import pytest
from known_pair import PAIR
from known_runs import ADDED, OFF, SHARED, estimates_table, instances, runs_table
from scipy.stats import chi2

from icpshap.estimators.kind import COVARIANCES, SAMPLES
from icpshap.explanation import directions, games, readings
from icpshap.explanation.method import Method
from icpshap.tables import XI

VECTOR = directions.VECTOR


def explained(runs=None, estimates=None, returns=SAMPLES, **method):
    given = (runs, estimates, instances(), OFF, returns, Method(**method), PAIR)
    return games.explain(*given).directions.set_index("direction")


def truth(values):
    """Covariance in the reference's axes for infinitely many runs; values: the causes on."""
    turn = PAIR.to_reference_axes
    return turn @ np.diag(SHARED**2 + sum(ADDED[name] ** 2 for name in values)) @ turn.T


def test_variances_are_those_of_the_runs_turned_into_the_references_axes():
    runs = runs_table()
    on = (runs[list(OFF)] == [0.05, 1.5, 0.05]).all(axis=1)
    turned = runs.loc[on, XI].to_numpy() @ PAIR.to_reference_axes.T
    table = explained(runs)
    for k, name in enumerate(directions.AXES):
        assert table.value[name] == pytest.approx(turned[:, k].var(ddof=1))
    assert table.value["rotation"] == pytest.approx(turned[:, :3].var(axis=0, ddof=1).sum())
    assert table.value["translation"] == pytest.approx(turned[:, 3:].var(axis=0, ddof=1).sum())


def test_parts_are_the_variances_that_independent_causes_add():
    """Exactly so where an estimator gives the covariances themselves."""
    table = explained(None, estimates_table(), COVARIANCES)
    clean = np.diag(truth([]))
    for k, name in enumerate(directions.AXES):
        assert table.clean[name] == pytest.approx(clean[k])
        for cause in OFF:
            added = np.diag(truth([cause]))[k] - clean[k]
            for part in (f"phi_{cause}", f"removal_{cause}"):
                assert table[part][name] == pytest.approx(added, abs=1e-15)
            remaining = table.value[name] - added
            assert table[f"remaining_{cause}"][name] == pytest.approx(remaining)


def test_parts_and_clean_value_add_up():
    table = explained(runs_table(noise_draws=10), bias_correction="jackknife")
    total = table.clean + table[[f"phi_{name}" for name in OFF]].sum(axis=1)
    np.testing.assert_allclose(total, table.value, rtol=1e-9)
    assert (table.value_low <= table.value).all() and (table.value <= table.value_high).all()


def test_the_weakest_direction_is_the_largest_axis_in_metres():
    row = explained(None, estimates_table(), COVARIANCES).loc["weakest"]
    unit = np.repeat([PAIR.characteristic_length, 1.0], 3)
    scaled = unit[:, None] * truth(OFF) * unit
    values, vectors = np.linalg.eigh(scaled)
    vector = row[VECTOR].to_numpy(dtype=float)
    assert row.value == pytest.approx(values[-1])
    assert abs(vector @ vectors[:, -1]) == pytest.approx(1)
    assert vector[np.abs(vector).argmax()] > 0


def test_directions_in_words():
    assert directions.in_words([0, 0, 0, 1.0, 0, 0]) == "along x"
    assert directions.in_words([0, 0, 1.0, 0.1, 0, 0]) == "yaw"
    assert directions.in_words([0, 0.6, 0, 0, 0.8, 0]) == "along y, pitch"


def test_a_level_shift_is_error_and_no_variance():
    runs = runs_table()
    runs.loc[runs["sensor_noise"] > 0, "xi_4"] += 0.05
    table = explained(runs)
    error = table.loc["error_translation"]
    assert error.phi_sensor_noise == pytest.approx(0.05**2, rel=0.1)
    assert error.in_per_cent
    assert table.phi_sensor_noise["translation"] < 1e-4
    assert error.quantile_95 > 0.05 > error.clean_quantile_95


def test_errors_hold_every_run_that_did_not_fail():
    runs = runs_table(wrong=[3, 60], failed=[(7, 5)])
    on = (runs[list(OFF)] == [0.05, 1.5, 0.05]).all(axis=1) & (runs["run"] != 5)
    translation, _ = readings.pose_errors(runs.loc[on, XI].to_numpy())
    table = explained(runs, wrong_basins="leave_out")
    assert table.value["error_translation"] == pytest.approx(np.square(translation).mean())
    quantile = np.quantile(translation, 0.95)
    assert table.quantile_95["error_translation"] == pytest.approx(quantile)
    assert table.value["translation"] < 0.1 * table.value["error_translation"]


def test_shares_of_the_growth_add_up_to_one_and_are_there_where_it_is_sure():
    table = explained(runs_table(), bias_correction="jackknife")
    shares = table[[f"share_{name}" for name in OFF]]
    told = table.in_per_cent
    assert told["error_translation"] and told["translation"]
    np.testing.assert_allclose(shares[told].sum(axis=1), 1.0, rtol=1e-9)
    assert shares[~told].isna().all(axis=None)
    row = table.loc["error_translation"]
    for name in OFF:
        assert row[f"share_{name}_low"] <= row[f"share_{name}"] <= row[f"share_{name}_high"]
        assert row[f"share_{name}"] == pytest.approx(row[f"phi_{name}"] / row.growth, rel=0.05)
    narrowed = runs_table()
    narrowed[XI] *= np.where(narrowed["sensor_noise"] > 0, 0.05, 1.0)[:, None]
    table = explained(narrowed)
    assert not table.in_per_cent["error_translation"]
    assert table[[f"share_{name}_low" for name in OFF]].isna().all(axis=None)


@pytest.mark.parametrize("noise_draws", [1, 10])
def test_the_interval_of_a_quantile_holds_the_truth_as_often_as_it_says(noise_draws):
    """Of 1,000 samples of 100 runs; with several noise draws half of the variance is theirs."""
    generator = np.random.default_rng(5)
    own, common = generator.standard_normal((2, 1000, noise_draws, 100 // noise_draws, 3))
    common = common[:, :, :1] if noise_draws > 1 else common
    error = np.linalg.norm(np.sqrt(0.5) * (own + common), axis=-1).reshape(1000, 100)
    value, low, high = directions.quantiles_with_interval(
        error, np.repeat(np.arange(noise_draws), 100 // noise_draws)
    )
    np.testing.assert_allclose(value, np.quantile(error, 0.95, axis=1))
    assert (low <= value).all() and (value <= high).all()
    held = (low <= np.sqrt(chi2.ppf(0.95, 3))) & (np.sqrt(chi2.ppf(0.95, 3)) <= high)
    assert 0.92 <= held.mean() <= 0.99
    # Ten values, all runs of a draw alike, bound a 95 % quantile from below only.
    alike = np.repeat(error[:, :10], 10, axis=1)
    _, low, high = directions.quantiles_with_interval(alike, np.repeat(np.arange(10), 10))
    assert np.isinf(high).all() and np.isfinite(low).all()


def test_covariances_alone_have_no_error():
    table = explained(None, estimates_table(), COVARIANCES)
    assert table.loc[["error_rotation", "error_translation"], "value"].isna().all()
    assert table.value.notna().sum() == 9
    assert table.value_low.isna().all()
