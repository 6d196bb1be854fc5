"""KL and the other readings: known values, invariance, bias and null against simulation."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, wishart

from icpshap import se3
from icpshap.explanation import readings

LENGTH = 3.0


def random_covariances(seed, *shape):
    factors = np.random.default_rng(seed).normal(size=(*shape, 6, 9))
    return factors @ np.swapaxes(factors, -1, -2) / 9


def spread_of(xi, weights, floor_rotation=0.0, floor_translation=0.0):
    floor = floor_rotation, floor_translation
    of_runs = {**readings.run_numbers(xi, LENGTH), "lost": np.abs(xi[..., 0]) > 1}
    return readings.Spread(xi, weights, floor, of_runs=of_runs)


@pytest.fixture
def poses():
    """T_gt and two samples of poses around it, (4, 4) and (2, 80, 4, 4)."""
    generator = np.random.default_rng(3)
    T_gt = se3.exp(np.array([0.3, -1.0, 0.7, 4.0, -2.0, 1.0]))
    spread = np.array([[[0.02]], [[0.05]]]) * np.array([1.0, 0.5, 2.0, 3.0, 1.0, 2.0])
    return T_gt, T_gt @ se3.exp(generator.normal(size=(2, 80, 6)) * spread)


def test_kl_of_a_distribution_with_itself_is_zero():
    covariance = random_covariances(0)
    assert readings.kullback_leibler(covariance, covariance) == pytest.approx(0, abs=1e-12)


def test_kl_of_scaled_covariances_has_its_closed_form():
    covariance = random_covariances(1)
    for scale in (0.1, 1.0, 7.0):
        expected = 3.0 * (1.0 / scale - 1.0 + np.log(scale))
        assert readings.kullback_leibler(covariance, scale * covariance) == pytest.approx(
            expected, abs=1e-12
        )


def test_kl_is_the_mean_logarithm_of_the_density_ratio():
    clean, perturbed = random_covariances(2, 2)
    normal = multivariate_normal(np.zeros(6), clean)
    x = normal.rvs(200_000, random_state=0)
    ratio = normal.logpdf(x) - multivariate_normal(np.zeros(6), perturbed).logpdf(x)
    error = ratio.std() / np.sqrt(len(ratio))
    assert abs(readings.kullback_leibler(clean, perturbed) - ratio.mean()) < 4 * error


def test_kl_works_on_leading_dimensions():
    clean, perturbed = random_covariances(3, 4), random_covariances(4, 5, 4)
    together = readings.kullback_leibler(clean, perturbed)
    assert together.shape == (5, 4)
    assert together[2, 3] == readings.kullback_leibler(clean[3], perturbed[2, 3])


def test_kl_does_not_depend_on_left_or_right_residuals(poses):
    T_gt, T = poses
    right = se3.log(se3.inverse(T_gt) @ T)
    left = se3.log(T @ se3.inverse(T_gt))
    f = [
        readings.kullback_leibler(*readings.covariance(residuals, 0.0, 0.0))
        for residuals in (right, left)
    ]
    assert f[0] > 1
    assert f[1] == pytest.approx(f[0], rel=1e-9)


def test_a_singular_covariance_without_floor_is_an_error():
    xi = np.random.default_rng(0).normal(size=(50, 6))
    xi[:, 2] = 0.5
    clean = readings.covariance(xi, 0.0, 0.0)
    with pytest.raises(np.linalg.LinAlgError):
        readings.kullback_leibler(clean, clean)


def test_covariance_is_numpys_plus_the_floor():
    xi = np.random.default_rng(0).normal(size=(3, 40, 6))
    expected = np.cov(xi[1].T) + np.diag([0.04, 0.04, 0.04, 0.09, 0.09, 0.09])
    np.testing.assert_allclose(readings.covariance(xi, 0.2, 0.3)[1], expected)


def test_spread_of_weighted_runs_is_that_of_repeated_runs():
    xi = np.random.default_rng(0).normal(size=(2, 30, 6))
    weights = np.random.default_rng(1).integers(0, 4, size=(5, 30))
    spread = spread_of(xi, weights, 0.1, 0.2)
    repeated = np.repeat(xi[1], weights[3], axis=0)
    np.testing.assert_allclose(
        spread.covariance[1, 3], readings.covariance(repeated, 0.1, 0.2), rtol=1e-12
    )
    translation = se3.exp(repeated)[:, :3, 3]
    assert spread.mean("square_translation")[1, 3] == pytest.approx((translation**2).sum(1).mean())
    assert spread.mean("square_rotation")[1, 3] == pytest.approx(
        (repeated[:, :3] ** 2).sum(1).mean()
    )


def test_spread_without_a_far_run_is_exact():
    xi = 1e-7 * np.random.default_rng(0).normal(size=(100, 6)) + 0.01
    xi[7] += 1.0
    kept = np.arange(100) != 7
    spread = spread_of(xi, np.stack([np.ones(100), kept]))
    expected = np.cov(xi[kept].T)
    np.testing.assert_allclose(spread.covariance[1], expected, atol=1e-8 * expected.max())


def test_failed_runs_of_weight_zero_do_not_matter():
    xi = np.random.default_rng(0).normal(size=(60, 6))
    weights = np.ones((1, 60))
    weights[0, 11] = 0
    whole = spread_of(xi, weights).covariance
    xi[11] = np.nan
    np.testing.assert_array_equal(spread_of(xi, weights).covariance, whole)


def test_pose_errors_are_those_of_the_matrix():
    xi = np.random.default_rng(0).normal(size=(50, 6))
    xi[0, :3] = 0.0
    translation, rotation = readings.pose_errors(xi)
    T = se3.exp(xi)
    np.testing.assert_allclose(translation, np.linalg.norm(T[:, :3, 3], axis=1), rtol=1e-12)
    cosine = (np.trace(T[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    np.testing.assert_allclose(np.cos(rotation), cosine, atol=1e-12)


def test_readings_follow_from_one_another():
    xi = np.random.default_rng(5).normal(size=(2, 70, 6)) * np.array([1.0, 1.5])[:, None, None]
    clean, perturbed = (spread_of(x, np.ones((1, 70))) for x in xi)
    f = {
        name: reading.evaluate(clean, perturbed, False)[0]
        for name, reading in readings.READINGS.items()
    }
    assert f["kl"] == readings.kullback_leibler(clean.covariance, perturbed.covariance)[0]
    assert f["reverse_kl"] == readings.kullback_leibler(perturbed.covariance, clean.covariance)[0]
    assert f["symmetric_kl"] == pytest.approx(f["kl"] + f["reverse_kl"])
    logarithms = [np.linalg.slogdet(np.cov(x.T))[1] for x in xi]
    assert f["entropy_difference"] == pytest.approx((logarithms[1] - logarithms[0]) / 2)
    translation = np.linalg.norm(se3.exp(xi[1])[:, :3, 3], axis=1)
    assert f["translation_rmse"] == pytest.approx(np.sqrt((translation**2).mean()))
    rotation = np.linalg.norm(xi[1, :, :3], axis=1)
    assert f["rotation_rmse"] == pytest.approx(np.sqrt((rotation**2).mean()))
    away = (xi[1] - np.median(xi[1], axis=0)) * [LENGTH, LENGTH, LENGTH, 1, 1, 1]
    logarithms = np.log(np.hypot(np.linalg.norm(away, axis=1), 1e-3))
    assert f["log_error"] == pytest.approx(logarithms.mean())
    assert f["wrong_basin_share"] == pytest.approx((np.abs(xi[1, :, 0]) > 1).mean())
    assert {r.unit for r in readings.READINGS.values()} == {"nats", "m", "rad", "of 1"}


def test_a_far_run_adds_its_logarithm_over_n_to_the_log_error():
    xi = 0.01 * np.random.default_rng(0).normal(size=(100, 6)) / [LENGTH, LENGTH, LENGTH, 1, 1, 1]
    before = readings.run_numbers(xi, LENGTH)["log_error"]
    xi[7] += [0.0, 0.0, 0.0, 5.0, 0.0, 0.0]
    after = readings.run_numbers(xi, LENGTH)["log_error"]
    assert after.mean() - before.mean() == pytest.approx((np.log(5.0) - before[7]) / 100, abs=0.003)


def test_failed_runs_have_no_say_in_the_median_pose():
    xi = 0.01 * np.random.default_rng(0).normal(size=(2, 60, 6))
    failed = np.concatenate([xi, np.full((2, 30, 6), np.nan)], axis=1)
    expected = readings.run_numbers(xi, LENGTH)["log_error"]
    found = readings.run_numbers(failed, LENGTH)["log_error"]
    np.testing.assert_array_equal(found[:, :60], expected)
    assert np.isnan(found[:, 60:]).all()


@pytest.mark.parametrize("n", [40, 100])
def test_null_mean_and_quantile_are_those_of_samples(n):
    xi = np.random.default_rng(n).normal(size=(2, 4000, n, 6)) @ np.diag([1, 2, 3, 4, 5, 6])
    f = readings.kullback_leibler(*readings.covariance(xi, 0.0, 0.0))
    error = f.std() / np.sqrt(len(f))
    assert abs(f.mean() - readings.null_mean("kl", n)) < 4 * error
    assert readings.null_quantile("kl", n, 0.95) == pytest.approx(np.quantile(f, 0.95), rel=0.03)


def test_null_of_a_hundred_runs():
    assert readings.null_mean("kl", 100) == pytest.approx(42 / 184)
    assert readings.null_quantile("kl", 100, 0.95) == pytest.approx(0.368, abs=0.005)
    assert readings.null_mean("symmetric_kl", 100) == pytest.approx(84 / 184)
    assert readings.null_mean("entropy_difference", 100) == 0
    assert np.isnan(readings.null_quantile("rotation_rmse", 100, 0.95))


@pytest.mark.parametrize("name", ["kl", "reverse_kl", "symmetric_kl", "entropy_difference"])
def test_unbiased_readings_have_the_true_mean_for_unequal_n(name):
    reading = readings.READINGS[name]
    truth = random_covariances(6, 2)
    generator = np.random.default_rng(0)
    samples = [
        readings.Moments(wishart.rvs(n - 1, covariance, 20_000, generator) / (n - 1), np.float64(n))
        for n, covariance in zip((30, 70), truth, strict=True)
    ]
    exact = [readings.Moments(covariance, None) for covariance in truth]
    unbiased = reading.evaluate(*samples, True)
    error = unbiased.std() / np.sqrt(len(unbiased))
    expected = reading.evaluate(*exact, False)
    assert abs(unbiased.mean() - expected) < 4 * error
    assert abs(reading.evaluate(*samples, False).mean() - expected) > 10 * error


def test_floor_share_is_the_largest_of_the_directions():
    covariance = np.diag([1.0, 4.0, 1.0, 2.0, 1.0, 1.0]) + readings.floor_matrix(0.5, 3.0)
    share = readings.floor_share(covariance, 0.5, 3.0)
    assert share == pytest.approx(9.0 / 10.0)
    assert readings.floor_share(covariance, 0.0, 0.0) == 0
