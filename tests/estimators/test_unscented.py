"""The unscented transform: against the authors' own program, and on a linear registration."""

from types import SimpleNamespace

import numpy as np
import pytest
from estimated_room import covariances, estimate
from oracle_pair import COALITIONS, PLANES, OraclePair, relative_error

from icpshap import config as configuration
from icpshap import icp, se3
from icpshap.errors import UserError
from icpshap.estimators import unscented
from icpshap.estimators.unscented import Unscented

SCALES = {"0": 1.0, "1": 1.5}


def test_sigma_points_are_those_of_the_oracle(oracle, estimator_oracle):
    expected = np.load(estimator_oracle / "brossard_ut.npz")["sigma_points"]
    deviation = np.load(oracle / "inputs.npz")["std"]
    for k, coalition in enumerate(COALITIONS):
        found = unscented.sigma_points(np.sqrt(SCALES[coalition[1]]) * deviation)
        np.testing.assert_allclose(found, expected[k], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("composition", ["left", "right"])
def test_the_chain_ends_where_the_oracles_does(oracle, estimator_oracle, composition):
    expected, pair = np.load(estimator_oracle / "brossard_ut.npz"), OraclePair(oracle)
    references = {
        kind: icp.Reference(pair.reference(coalition))
        for kind, coalition in (("0", "000"), ("1", "100"))
    }
    for k, coalition in enumerate(COALITIONS):
        source = pair.source(coalition)
        T_initial = unscented.composed(pair.T_true, expected["sigma_points"][k], composition)
        rows = [np.arange(len(source))] * len(T_initial)
        found = icp.register(references[coalition[0]], source, rows, T_initial, PLANES)
        np.testing.assert_allclose(
            found.T_reference_source, expected[f"T_{composition}"][k], atol=1e-9
        )
        np.testing.assert_array_equal(found.iterations, expected[f"iters_{composition}"][k])


@pytest.mark.parametrize("composition", ["left", "right"])
def test_the_scatter_is_that_of_the_authors_program(estimator_oracle, composition):
    expected = np.load(estimator_oracle / "brossard_ut.npz")
    for k in range(len(COALITIONS)):
        T = expected[f"T_{composition}"][k]
        of_oracle = expected[f"cov_ut_{composition}"][k]
        if composition == "left":
            adjoint = se3.adjoint(se3.inverse(T[0]))
            of_oracle = adjoint @ of_oracle @ adjoint.T
        assert relative_error(unscented.scatter(T, composition), of_oracle) < 1e-12


@pytest.mark.parametrize("composition", ["left", "right"])
def test_a_linear_registration_gives_the_transformed_covariance(composition):
    """T_n = T exp(A sp), or exp(A sp) T: A Sigma A^T, exactly."""
    generator = np.random.default_rng(2)
    A = 0.1 * generator.normal(size=(6, 6))
    deviation = generator.uniform(0.05, 0.2, 6)
    T = se3.exp(generator.normal(size=6))
    ends = unscented.composed(T, unscented.sigma_points(deviation) @ A.T, composition)
    expected = A @ np.diag(deviation**2) @ A.T
    if composition == "left":
        adjoint = se3.adjoint(se3.inverse(T))
        expected = adjoint @ expected @ adjoint.T
    np.testing.assert_allclose(
        unscented.scatter(ends, composition), expected, rtol=1e-10, atol=1e-14
    )


@pytest.fixture
def ended(monkeypatch):
    """Registrations that end where a test says: where they began, with a status each."""

    def of(status):
        def register(reference, source, rows, T_initial, chain):
            number = len(T_initial)
            repeated = np.resize(np.array(status), number)
            zero = np.zeros(number)
            return SimpleNamespace(
                T_reference_source=np.array(T_initial), iterations=np.arange(number),
                status=repeated, rmse=zero, inlier_ratio=zero,
            )  # fmt: skip

        monkeypatch.setattr(icp, "register", register)

    return of


def test_registrations_that_stay_where_they_begin_give_the_initial_covariance(room_pair, ended):
    """Plus the closed form at the true pose."""
    ended(["ok"])
    clean, wide = covariances(
        estimate(
            room_pair, [(0, 1.0, 0), (0, 4.0, 0)], "unscented", initial_pose_composition="right"
        )
    )
    deviation = np.diag(np.repeat([np.deg2rad(10) ** 2, 0.2**2], 3) / 3)
    np.testing.assert_allclose(wide - clean, 3 * deviation, atol=1e-12)
    (white,) = covariances(estimate(room_pair, [(0, 1.0, 0)]))
    np.testing.assert_allclose(clean, deviation + white, atol=1e-12)


@pytest.mark.parametrize(
    ("of_one", "status"),
    [("ok", "ok"), ("max_iterations", "max_iterations"), ("degenerate", "degenerate")],
)
def test_one_failed_sigma_point_fails_the_setting(room_pair, ended, of_one, status):
    ended(["ok"] * 12 + [of_one])
    table = estimate(room_pair, [(0.0, 1.0, 0.0)], "unscented")
    assert table["status"].tolist() == [status]
    assert np.isnan(covariances(table)).all() == (status == "degenerate")


def test_noise_draws_take_masks_of_their_own():
    assert Unscented().number_of_runs(3) == 39


def test_the_bias_is_added(room_pair):
    values = [(0.02, 1.0, 0.0)]
    without, with_bias = (
        covariances(estimate(room_pair, values, "unscented", bias=bias))[0]
        for bias in (False, True)
    )
    added = with_bias - without
    assert np.linalg.matrix_rank(added, tol=1e-6 * np.abs(added).max(), hermitian=True) == 1


def test_a_bias_along_normals_that_there_are_none_of_is_refused(config):
    config["estimators"]["odd"] = {
        "kind": "unscented", "metric": "point_to_point", "bias": True
    }  # fmt: skip
    with pytest.raises(UserError, match=r"estimators.odd.bias: is along the normals"):
        configuration.load(config)


def test_ends_in_another_basin_are_counted():
    xi = np.zeros((13, 6))
    xi[3, 4], xi[7, 2], xi[9, 5] = 0.2, np.deg2rad(3), 0.05
    assert unscented.far(se3.exp(np.full((1, 6), 0.3)) @ se3.exp(xi)) == 2
