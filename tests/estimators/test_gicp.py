"""Generalised ICP: against small_gicp, against plain numpy, and its own promises."""

from dataclasses import replace

import numpy as np
import pytest
from estimated_room import covariances, estimate, flat
from oracle_pair import COALITIONS, OraclePair, relative_error

from icpshap import se3
from icpshap.estimators import gicp
from icpshap.icp.plane_to_plane import FLATNESS
from icpshap.tables import COVARIANCE, TRANSFORM

STOP = (1e-6, 1e-6)


def planar(points, neighbours=20):
    return gicp.Planar.of(points, neighbours)


def test_poses_and_hessians_are_those_of_small_gicp(oracle, estimator_oracle):
    expected, pair = np.load(estimator_oracle / "gicp.npz"), OraclePair(oracle)
    references = {
        kind: planar(pair.reference(coalition)) for kind, coalition in (("0", "000"), ("1", "100"))
    }
    for k, coalition in enumerate(COALITIONS):
        reference, points = references[coalition[0]], pair.source(coalition)
        assert len(points) == expected["n_source"][k]
        source = planar(points)
        at = gicp.linearise(reference, source, expected["T"][k], 1.0)
        assert at.links == expected["inliers"][k]
        assert relative_error(at.matrix, expected["own_H"][k]) < 1e-12
        assert relative_error(at.weighted / 2, expected["own_error"][k]) < 1e-12
        # The gradient vanishes there: a sum of terms of which each is as large as its root.
        size = np.sqrt(np.diag(at.matrix) * at.weighted)
        # Of theirs J = [R [s]x, -R].
        assert (np.abs(at.gradient + expected["own_b"][k]) < 1e-12 * size).all()
        assert relative_error(at.matrix, expected["H_at_T"][k]) < 1e-12
        end = gicp.register(reference, source, pair.T_true, 1.0, 100, STOP)
        np.testing.assert_allclose(end.T_reference_source, expected["T"][k], atol=1e-9)
        oscillates = coalition in ("100", "110")
        assert end.status == ("max_iterations" if oscillates else "ok")


def test_the_sums_are_those_of_plain_matrices(room_pair):
    """Every link with its own 3x3 matrices, inverted, as the formula has it."""
    generator = np.random.default_rng(4)
    noisy = room_pair.reference[:300] + generator.normal(0, 0.02, (300, 3))
    reference, source = planar(noisy), planar(room_pair.source[:200])
    T = room_pair.T_reference_source @ se3.exp(generator.normal(0, 0.02, 6))
    R = T[:3, :3]

    def covariance(normals):
        return np.eye(3) - (1 - FLATNESS) * normals[:, :, None] * normals[:, None, :]

    moved = se3.transform(T, source.points)
    distance = np.linalg.norm(moved[:, None] - reference.points, axis=2)
    nearest = distance.argmin(axis=1)
    linked = distance.min(axis=1) <= 0.3
    residual = (reference.points[nearest] - moved)[linked]
    weights = np.linalg.inv(
        covariance(reference.normals[nearest]) + R @ covariance(source.normals) @ R.T
    )[linked]
    jacobian = np.concatenate(
        [R @ se3.hat(source.points[linked]), np.broadcast_to(-R, (linked.sum(), 3, 3))], axis=2
    )
    found = gicp.linearise(reference, source, T, 0.3)
    assert found.links == linked.sum() < 200
    matrix = np.einsum("lax,lab,lby->xy", jacobian, weights, jacobian)
    gradient = np.einsum("lax,lab,lb->x", jacobian, weights, residual)
    np.testing.assert_allclose(found.matrix, matrix, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(found.gradient, -gradient, rtol=1e-10, atol=1e-10)
    weighted = np.einsum("la,lab,lb->", residual, weights, residual)
    assert found.weighted == pytest.approx(weighted, rel=1e-10)
    assert found.squared == pytest.approx((residual**2).sum(), rel=1e-10)


def test_the_initial_pose_changes_nothing_at_all(room_pair):
    table = estimate(room_pair, [(0.02, s, 0.1) for s in (1.0, 1.5, 9.0)], "gicp")
    first, *others = table[COVARIANCE + TRANSFORM].to_numpy()
    assert all(np.array_equal(first, other) for other in others)


def test_scaled_by_the_residuals_it_is_the_same_but_for_a_number(room_pair):
    plain, scaled = (
        covariances(estimate(room_pair, [(0.02, 1.0, 0.0)], "gicp", scale=scale))[0]
        for scale in ("none", "residuals")
    )
    ratio = scaled / plain
    np.testing.assert_allclose(ratio, ratio[0, 0], rtol=1e-9)
    # The unit is 1 m^2 in the plane, and the scatter along the normals is 2 cm.
    assert ratio[0, 0] < 0.1


def test_it_recovers_the_true_pose(room_pair):
    (row,) = estimate(room_pair, [(0.0, 1.0, 0.0)], "gicp")[TRANSFORM].to_numpy()
    error = se3.log(se3.inverse(room_pair.T_reference_source) @ row.reshape(4, 4))
    assert np.abs(error).max() < 0.01


@pytest.mark.parametrize("fewer", [0, 19])
def test_fewer_points_than_neighbours_are_too_few(room_pair, fewer):
    """Whether or not the subsample is empty."""
    pair = replace(
        room_pair, source=room_pair.source[:fewer], overlapping=room_pair.overlapping[:fewer]
    )
    (row,) = estimate(pair, [(0.0, 1.0, 0.0)], "gicp").itertuples()
    assert (row.status, row.iterations, row.inlier_ratio) == ("too_few_links", 0, 0.0)
    assert np.isnan(row.covariance_00)


def test_clouds_far_apart_have_too_few_links(room_pair):
    reference, source = planar(room_pair.reference), planar(room_pair.source[:100])
    far = se3.exp([0, 0, 0, 100.0, 0, 0])
    end = gicp.register(reference, source, far, 1.0, 100, STOP)
    assert (end.status, end.iterations) == ("too_few_links", 0)


def test_points_on_a_line_are_degenerate():
    """On a plane every direction has its weight; about a line nothing turns."""
    on_line = np.column_stack([np.linspace(1, 5, 100), np.full(100, 2.0), np.full(100, 2.0)])
    end = gicp.register(planar(flat(500, 0)), planar(on_line), np.eye(4), 1.0, 100, STOP)
    assert end.status == "degenerate"
