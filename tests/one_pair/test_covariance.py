"""Covariances in the conventions of others."""

import numpy as np
import pytest

from icpshap import se3
from icpshap.errors import UserError
from icpshap.one_pair.covariance import PoseCovariance

T = se3.exp(np.array([0.4, -0.2, 0.9, 1.0, -2.0, 0.5]))


@pytest.fixture
def drawn():
    """Small errors xi (n, 6) of T exp(xi), and their covariance."""
    generator = np.random.default_rng(0)
    root = 1e-4 * generator.standard_normal((6, 6))
    xi = generator.standard_normal((4000, 6)) @ root.T
    return xi, PoseCovariance(np.cov(xi.T), 0.5, 0.0, T)


def test_ros_has_the_spread_of_the_position_and_of_turns_about_fixed_axes(drawn):
    xi, covariance = drawn
    poses = T @ se3.exp(xi)
    moved = poses[:, :3, 3] - T[:3, 3]
    turned = se3.log(poses @ se3.inverse(T))[:, :3]
    expected = np.cov(np.hstack([moved, turned]).T)
    found = covariance.to("ros")
    assert np.asarray(found) == pytest.approx(expected, rel=1e-2, abs=1e-3 * expected.max())
    assert (found.order, found.unit) == ("translation first", "m^2, m rad, rad^2")


def test_gtsam_has_the_same_tangent_vector(drawn):
    _, covariance = drawn
    assert covariance.to("gtsam") is covariance
    assert covariance.order == "rotation first"


def test_of_all_points_is_a_scaling_and_says_so(drawn):
    _, covariance = drawn
    scaled = covariance.of_all_points()
    assert np.asarray(scaled) == pytest.approx(0.5 * covariance.matrix)
    assert "scaled by 0.5" in repr(scaled)
    assert "too small for what all points share" in repr(scaled)
    assert scaled.to_dict()["scaled"]


def test_another_convention_is_refused(drawn):
    with pytest.raises(UserError, match="expected one of icpshap, gtsam, ros"):
        drawn[1].to("euler")
    with pytest.raises(UserError, match="already"):
        drawn[1].to("ros").to("gtsam")


def test_what_it_is_not_of_is_said():
    covariance = PoseCovariance(np.eye(6), 1.0, 0.17, T)
    assert "WITHOUT the 17% of the runs" in repr(covariance)
    assert "WITHOUT the 17% of the runs" in repr(covariance.to("ros"))
