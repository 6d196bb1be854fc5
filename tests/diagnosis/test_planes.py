import numpy as np
import pytest

from icpshap.diagnosis.planes import planes


def patch(points=4000, noise=0.0, seed=0):
    """Points of a wall, 4 m before a scanner."""
    generator = np.random.default_rng(seed)
    cloud = np.column_stack([np.full(points, 4.0), generator.uniform(-1, 1, (points, 2))])
    return cloud + generator.normal(0, noise, cloud.shape)


def rings(noise=0.0, seed=0):
    """A wall as 16 rings of a spinning scanner see it, with noise along the beams."""
    elevation, azimuth = np.meshgrid(
        np.deg2rad(np.linspace(-8, 8, 16)), np.linspace(-0.5, 0.5, 600)
    )
    beams = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    ).reshape(-1, 3)
    ranges = 4.0 / beams[:, 0] + np.random.default_rng(seed).normal(0, noise, len(beams))
    return ranges[:, None] * beams


def test_the_residual_of_a_plane_is_its_noise():
    found = planes(patch(noise=0.01), np.arange(0, 4000, 10))
    assert np.median(found.residuals) == pytest.approx(0.01, rel=0.15)
    assert np.median(np.abs(found.normals[:, 0])) > 0.99


def test_a_plane_without_noise_has_no_residual():
    found = planes(patch(), np.arange(100))
    assert found.residuals.max() < 1e-8
    assert np.abs(found.normals[:, 0]).min() == pytest.approx(1.0)


def test_the_ten_nearest_on_a_ring_are_not_enough():
    cloud = rings(noise=0.02)
    found = planes(cloud, np.arange(0, len(cloud), 20))
    known = np.isfinite(found.residuals)
    assert known.mean() > 0.95
    # Noise along the beams, which the points of one ring alone would hide.
    assert np.median(found.residuals[known]) == pytest.approx(0.02, rel=0.2)
    assert np.median(np.abs(found.normals[known, 0])) > 0.95


def test_noise_as_wide_as_a_neighbourhood_is_still_seen():
    small, large = (
        np.median(planes(patch(noise=sigma), np.arange(0, 4000, 10)).residuals)
        for sigma in (0.03, 0.06)
    )
    assert large / small == pytest.approx(2.0, rel=0.2)


def test_too_few_points_have_no_plane():
    found = planes(patch(points=9), np.arange(9))
    assert np.isnan(found.residuals).all() and np.isnan(found.normals).all()
