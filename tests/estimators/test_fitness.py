"""Covariances of the fitness score: the programs' formulas, and the score itself."""

import numpy as np
import pytest
from estimated_room import covariances, estimate
from oracle_pair import COALITIONS, OraclePair
from scipy.spatial import cKDTree

from icpshap import icp, se3
from icpshap.estimators import fitness
from icpshap.tables import TRANSFORM


def test_hdl_graph_slam_goes_from_its_smallest_to_its_largest_variance():
    np.testing.assert_allclose(fitness.hdl_graph_slam(0.0), [0.05**2] * 3 + [0.1**2] * 3)
    np.testing.assert_allclose(fitness.hdl_graph_slam(0.5), [0.2**2] * 3 + [5.0**2] * 3)
    share = (1 - np.exp(-20 * 0.03)) / (1 - np.exp(-10))
    assert fitness.hdl_graph_slam(0.03)[5] == pytest.approx(0.01 + 24.99 * share)


def test_the_score_is_that_of_small_gicp(oracle, estimator_oracle):
    expected, pair = np.load(estimator_oracle / "gicp.npz"), OraclePair(oracle)
    for k, coalition in enumerate(COALITIONS[:4]):
        nearest = icp.Matcher(icp.Reference(pair.reference(coalition)))
        moved = se3.transform(expected["T"][k], pair.source(coalition))
        assert nearest(moved)[0].mean() == pytest.approx(expected["fitness"][k], rel=1e-12)


@pytest.mark.parametrize("formula", fitness.FORMULAS)
def test_the_score_is_the_mean_squared_distance_where_the_chain_ends(room_pair, formula):
    table = estimate(room_pair, [(0.0, 1.0, 0.0)], "fitness", formula=formula)
    T = table[TRANSFORM].to_numpy().reshape(4, 4)
    distance, _ = cKDTree(room_pair.reference).query(se3.transform(T, room_pair.source))
    expected = fitness.FORMULAS[formula](np.square(distance).mean())
    np.testing.assert_allclose(covariances(table)[0], np.diag(expected), rtol=1e-9)


def test_a_failed_registration_is_the_estimates_status(room_pair):
    table = estimate(room_pair, [(0.0, 1.0, 0.0)], "fitness", maximum_distance=1e-9)
    assert table["status"].tolist() == ["too_few_links"]
    assert np.isnan(covariances(table)).all()
