"""Order, axes and units of other programs: drawn poses have the covariance that is said."""

import numpy as np
import pytest
from known_measurements import covariance
from scipy.spatial.transform import Rotation

from icpshap import conventions, se3

T = se3.exp(np.array([0.4, -0.2, 0.9, 1.0, -2.0, 0.5]))


@pytest.fixture(scope="module")
def xi():
    """Small errors (n, 6) of T exp(xi), with exactly the covariance that is converted."""
    drawn = np.random.default_rng(0).standard_normal((3000, 6))
    drawn -= drawn.mean(axis=0)
    drawn = np.linalg.solve(np.linalg.cholesky(np.cov(drawn.T)), drawn.T).T
    return 0.1 * drawn @ np.linalg.cholesky(covariance(0)).T


@pytest.fixture(scope="module")
def poses(xi):
    return T @ se3.exp(xi)


def scaled(covariance):
    """In units of the standard deviations, so that no entry is too small to count."""
    scale = np.sqrt(np.diagonal(covariance))
    return covariance / np.outer(scale, scale), scale


def is_close(found, expected):
    correlation, scale = scaled(found)
    of_drawn, scale_of_drawn = scaled(expected)
    np.testing.assert_allclose(scale, scale_of_drawn, rtol=2e-3)
    np.testing.assert_allclose(correlation, of_drawn, atol=2e-3)


def test_ros_is_of_the_position_and_of_turns_about_fixed_axes(xi, poses):
    moved = poses[:, :3, 3] - T[:3, 3]
    turned = Rotation.from_matrix(poses[:, :3, :3] @ T[:3, :3].T).as_rotvec()
    is_close(conventions.ros(np.cov(xi.T), T), np.cov(np.hstack([moved, turned]).T))


def test_g2o_is_of_the_translation_and_the_vector_part_of_the_quaternion(xi, poses):
    # Of g2o's EdgeSE3: the true motion as it is seen from the measured one.
    error = se3.inverse(poses) @ T
    part = Rotation.from_matrix(error[:, :3, :3]).as_quat(canonical=True)[:, :3]
    is_close(conventions.g2o(np.cov(xi.T)), np.cov(np.hstack([error[:, :3, 3], part]).T))


def test_translation_first_is_of_the_same_vector(xi):
    swapped = np.cov(np.hstack([xi[:, 3:], xi[:, :3]]).T)
    np.testing.assert_allclose(conventions.translation_first(np.cov(xi.T)), swapped, rtol=1e-9)


@pytest.mark.parametrize("convert", [lambda S: conventions.ros(S, T), conventions.g2o])
def test_what_comes_is_symmetric_to_the_bit(convert):
    found = convert(covariance(1))
    assert (found == found.T).all()
