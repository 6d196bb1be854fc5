"""Intervals against brute-force resampling and against what is known of means and variances."""

import numpy as np
import pytest
from scipy.stats import t as student
from scipy.stats import ttest_1samp

from icpshap.explanation import readings as divergence
from icpshap.explanation.intervals import Resampling, jackknife_variance, mean_interval

ONE_DRAW = np.zeros(60, dtype=int)
SIX_DRAWS = np.repeat(np.arange(6), 10)


@pytest.fixture
def xi():
    """Runs (60, 6) of a clean and a perturbed setting, with common random numbers."""
    generator = np.random.default_rng(0)
    clean = generator.normal(size=(60, 6))
    return np.stack([clean, clean + generator.normal(size=(60, 6))])


def kl(xi):
    return divergence.kullback_leibler(*divergence.covariance(xi, 0.1, 0.1))


def kl_of_resamples(xi, plan):
    spread = divergence.Spread(xi, plan.weights, (0.1, 0.1))
    return divergence.kullback_leibler(*spread.covariance)


def test_jackknife_interval_is_that_of_deleting_runs_one_by_one(xi):
    plan = Resampling.of(np.ones(60, dtype=bool), ONE_DRAW)
    left_out = np.array([kl(np.delete(xi, run, axis=1)) for run in range(60)])
    middle = 60 * kl(xi) - 59 * left_out.mean()
    half = student.ppf(0.975, 59) * np.sqrt(59 / 60 * ((left_out - left_out.mean()) ** 2).sum())
    values = kl_of_resamples(xi, plan)
    assert plan.jackknife(values) == pytest.approx(middle, rel=1e-9)
    assert plan.interval(values) == pytest.approx((middle - half, middle + half), rel=1e-9)


def test_jackknife_deletes_whole_noise_draws_where_there_are_several(xi):
    kept = np.ones(60, dtype=bool)
    kept[[3, 17, 18]] = False
    plan = Resampling.of(kept, SIX_DRAWS)
    left_out = np.array([kl(xi[:, kept & (draw != SIX_DRAWS)]) for draw in range(6)])
    middle = 6 * kl(xi[:, kept]) - 5 * left_out.mean()
    half = student.ppf(0.975, 5) * np.sqrt(5 / 6 * ((left_out - left_out.mean()) ** 2).sum())
    values = kl_of_resamples(xi, plan)
    assert plan.interval(values) == pytest.approx((middle - half, middle + half), rel=1e-9)
    runs = [kl(xi[:, kept & (np.arange(60) != run)]) for run in np.flatnonzero(kept)]
    ratio = jackknife_variance(left_out) / jackknife_variance(np.array(runs))
    assert plan.draw_variance_ratio(values) == pytest.approx(ratio, rel=1e-9)


def test_one_noise_draw_says_nothing_about_the_variance_between_draws(xi):
    plan = Resampling.of(np.ones(60, dtype=bool), ONE_DRAW)
    assert np.isnan(plan.draw_variance_ratio(kl_of_resamples(xi, plan)))


@pytest.mark.parametrize("noise_draw", [ONE_DRAW, SIX_DRAWS])
def test_bootstrap_interval_mirrors_the_quantiles_of_repeated_units(xi, noise_draw):
    plan = Resampling.of(np.ones(60, dtype=bool), noise_draw, jackknife=False, bootstrap=300)
    values = kl_of_resamples(xi, plan)
    assert np.ptp(plan.weights[1:].reshape(300, 6, 10), axis=2).any() == (noise_draw is ONE_DRAW)
    again = [kl(np.repeat(xi, weights.astype(int), axis=1)) for weights in plan.weights[1:]]
    low, high = np.quantile(again, [0.025, 0.975])
    expected = 2 * kl(xi) - high, 2 * kl(xi) - low
    assert plan.interval(values) == pytest.approx(expected, rel=1e-9)


def test_bootstrap_is_seeded():
    kept = np.ones(60, dtype=bool)
    one, same, other = (
        Resampling.of(kept, ONE_DRAW, bootstrap=20, seed=seed).weights for seed in (1, 1, 2)
    )
    assert (one == same).all()
    assert (one != other).any()


def test_runs_left_out_stay_left_out():
    kept = np.arange(60) % 4 != 0
    plan = Resampling.of(kept, SIX_DRAWS, bootstrap=50)
    assert not plan.weights[:, ~kept].any()
    assert (plan.weights[plan.runs].sum(axis=1) == kept.sum() - 1).all()


def test_jackknife_makes_the_variance_unbiased():
    """It turns the mean square deviation (n) into the sample variance (n - 1), exactly."""
    x = np.random.default_rng(0).normal(size=60)
    plan = Resampling.of(np.ones(60, dtype=bool), ONE_DRAW)
    n = plan.weights.sum(axis=1)
    values = plan.weights @ x**2 / n - (plan.weights @ x / n) ** 2
    assert values[0] == pytest.approx(x.var())
    assert plan.jackknife(values) == pytest.approx(x.var(ddof=1))


def test_jackknife_interval_of_a_mean_is_students():
    x = np.random.default_rng(0).normal(size=60)
    plan = Resampling.of(np.ones(60, dtype=bool), ONE_DRAW)
    values = plan.weights @ x / plan.weights.sum(axis=1)
    expected = ttest_1samp(x, 0).confidence_interval(0.95)
    assert plan.interval(values) == pytest.approx(tuple(expected))


def test_mean_interval_is_students():
    values = np.random.default_rng(0).normal(size=(5, 3))
    mean, low, high = mean_interval(values)
    expected = ttest_1samp(values, 0).confidence_interval(0.95)
    np.testing.assert_allclose(mean, values.mean(axis=0))
    np.testing.assert_allclose([low, high], [expected.low, expected.high])
