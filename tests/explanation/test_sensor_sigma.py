"""f with another noise of the sensor, read off the same runs: exact where the law is known."""

import numpy as np
import pytest
from known_pair import PAIR
from known_runs import OFF, estimates_table, instances, runs_table

from icpshap.estimators.kind import COVARIANCES, SAMPLES, Returns
from icpshap.explanation import games, readings
from icpshap.explanation.method import Method
from icpshap.explanation.sample import samples
from icpshap.explanation.sensor_sigma import with_sensor_sigma
from icpshap.tables import COVARIANCE, XI

OWN = 0.01
TOLD = Returns(samples=False, covariances=True, sensor_sigma=OWN)
DRAWN = Returns(samples=True, covariances=False, exchangeable=True, sensor_sigma=OWN, drawn=True)


def explain_one(runs, estimates, returns, **method):
    given = (runs, estimates, instances(), OFF, returns, Method(**method), PAIR)
    return games.explain(*given).shap.iloc[0]


def told(own):
    """Estimates whose covariance is (own^2 + sigma^2) times one matrix."""
    table = estimates_table()
    unit = table[COVARIANCE].iloc[0].to_numpy()
    variance = own**2 + table["sensor_noise"].to_numpy() ** 2
    table[COVARIANCE] = variance[:, None] * unit
    return table


@pytest.mark.parametrize(("name", "times"), [("twice", 2.0), ("half", 0.5)])
def test_of_a_covariance_that_was_told_it_is_exact(name, times):
    row = explain_one(None, told(OWN), TOLD)
    other = explain_one(None, told(times * OWN), TOLD)
    for quantity in ("f", "phi_sensor_noise", "phi_initial_pose"):
        expected = pytest.approx(other[quantity], rel=1e-6, abs=1e-9)
        assert row[f"{quantity}_sensor_sigma_{name}"] == expected


def test_where_the_spread_does_not_hold_it_there_is_none():
    for given in ((runs_table(), None, SAMPLES), (None, estimates_table(), COVARIANCES)):
        row = explain_one(*given)
        assert np.isnan(row["f_sensor_sigma_twice"]) and np.isnan(
            row["phi_sensor_noise_sensor_sigma_half"]
        )


def drawn(own, draws=400, runs=5, seed=0):
    """Pose errors of runs whose draws scatter by own, and that scatter themselves."""
    generator = np.random.default_rng(seed)
    means = own * generator.standard_normal((draws, 1, 6)) * np.arange(1, 7)
    within = 0.02 * generator.standard_normal((draws, runs, 6))
    return (means + within).reshape(-1, 6), np.repeat(np.arange(draws), runs)


@pytest.mark.parametrize("times", [2.0, 0.5])
def test_of_draws_it_scales_what_they_scatter_beyond_their_runs(times):
    xi, noise_draw = drawn(OWN)
    runs = runs_table(levels={name: [off] for name, off in OFF.items()}, n=len(xi))
    runs[XI] = np.tile(xi, (len(runs) // len(xi), 1))
    runs["noise_draw"] = np.tile(noise_draw, len(runs) // len(xi))
    (sample,) = samples(runs, None, list(OFF), DRAWN, Method(), 1.0)
    found = with_sensor_sigma(sample, times).xi[0]
    expected = np.diag((times * OWN * np.arange(1, 7)) ** 2 + 0.02**2)
    covariance = readings.covariance(found, 0.0, 0.0)
    np.testing.assert_allclose(np.diag(covariance), np.diag(expected), rtol=0.2)
    # Runs of a draw lie about its mean as they did.
    inside = found.reshape(-1, 5, 6) - found.reshape(-1, 5, 6).mean(axis=1, keepdims=True)
    before = xi.reshape(-1, 5, 6) - xi.reshape(-1, 5, 6).mean(axis=1, keepdims=True)
    np.testing.assert_allclose(inside, before, atol=1e-12)


def test_the_same_noise_changes_nothing():
    xi, noise_draw = drawn(OWN, draws=10, runs=10)
    runs = runs_table(levels={name: [off] for name, off in OFF.items()}, n=100)
    runs[XI] = np.tile(xi, (len(runs) // 100, 1))
    runs["noise_draw"] = np.tile(noise_draw, len(runs) // 100)
    (sample,) = samples(runs, None, list(OFF), DRAWN, Method(), 1.0)
    np.testing.assert_allclose(with_sensor_sigma(sample, 1.0).xi, sample.xi, atol=1e-12)


def test_runs_whose_draws_share_it_have_no_null_of_independent_ones():
    runs = runs_table(noise_draws=10)
    row, usual = (explain_one(runs, None, returns) for returns in (DRAWN, SAMPLES))
    assert np.isnan(row["null_mean"]) and np.isnan(row["null_95"])
    assert usual["null_95"] > 0 and row["f_again"] == usual["f_again"]


def test_a_reading_that_is_not_of_covariances_has_no_other_sensor():
    row = explain_one(runs_table(noise_draws=10), None, DRAWN, divergence="wrong_basin_share")
    assert np.isnan(row["f_sensor_sigma_twice"])


def test_where_a_draw_has_no_runs_left_another_sensor_is_unknown_and_f_is_not():
    runs = runs_table(noise_draws=10)
    on = runs["sensor_noise"] > 0
    # Failed in one draw alone: nothing tells its place.
    runs.loc[on & (runs["noise_draw"] == 0), "status"] = "too_few_links"
    row = explain_one(runs, None, DRAWN)
    assert np.isfinite(row["f"]) and np.isnan(row["f_sensor_sigma_twice"])
