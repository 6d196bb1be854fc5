"""Facts about SE(3)."""

import numpy as np
import pytest
from scipy.linalg import expm

from icpshap import se3

RNG = np.random.default_rng(0)
XI = RNG.normal(scale=[0.6] * 3 + [2.0] * 3, size=(50, 6))


def hat6(xi):
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = se3.hat(xi[:3])
    matrix[:3, 3] = xi[3:]
    return matrix


def test_exp_is_the_matrix_exponential():
    np.testing.assert_allclose(se3.exp(XI), [expm(hat6(xi)) for xi in XI], atol=1e-13)


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-6, 1e-9, 0.0])
def test_log_inverts_exp_at_every_scale(scale):
    np.testing.assert_allclose(se3.log(se3.exp(scale * XI)), scale * XI, rtol=1e-9, atol=1e-24)


def test_translation_alone_has_zero_rotation_coordinates():
    T = np.eye(4)
    T[:3, 3] = [1, 2, 3]
    np.testing.assert_array_equal(se3.log(T), [0, 0, 0, 1, 2, 3])


def test_inverse_undoes():
    np.testing.assert_allclose(
        se3.inverse(se3.exp(XI)) @ se3.exp(XI), np.tile(np.eye(4), (50, 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(se3.inverse(se3.exp(XI)), se3.exp(-XI), atol=1e-13)


def test_adjoint_moves_a_perturbation_to_the_other_side():
    T, xi = se3.exp(XI[0]), XI[1]
    left = se3.exp(se3.adjoint(T) @ xi) @ T
    np.testing.assert_allclose(left, T @ se3.exp(xi), atol=1e-13)


def test_adjoint_is_a_homomorphism():
    A, B = se3.exp(XI[0]), se3.exp(XI[1])
    np.testing.assert_allclose(se3.adjoint(A @ B), se3.adjoint(A) @ se3.adjoint(B), atol=1e-13)


def test_transform_is_the_homogeneous_product():
    points = RNG.normal(size=(10, 3))
    homogeneous = np.column_stack([points, np.ones(10)])
    T = se3.exp(XI[0])
    np.testing.assert_allclose(se3.transform(T, points), (homogeneous @ T.T)[:, :3], atol=1e-14)


def test_any_number_of_leading_dimensions():
    xi = XI[:24].reshape(2, 3, 4, 6)
    assert se3.exp(xi).shape == (2, 3, 4, 4, 4)
    assert se3.adjoint(se3.exp(xi)).shape == (2, 3, 4, 6, 6)
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-12)


def test_a_reflection_is_refused():
    with pytest.raises(ValueError, match="determinant"):
        se3.log(np.diag([1.0, 1.0, -1.0, 1.0]))
