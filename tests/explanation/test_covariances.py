"""The covariance of every setting: of the runs that its f is read off, without a floor."""

import numpy as np
import pytest
from known_pair import PAIR, T_REFERENCE_SOURCE
from known_runs import OFF, covariance_of, estimates_table, instances, runs_table

from icpshap import tables
from icpshap.estimators.kind import COVARIANCES, SAMPLES, Returns
from icpshap.explanation import games
from icpshap.explanation.method import Method
from icpshap.tables import TRANSFORM, XI

SETTINGS = 8
BOTH = Returns(samples=True, covariances=True, exchangeable=True)


def explain(runs, estimates=None, returns=SAMPLES, reason="", **method):
    given = (runs, estimates, instances(), OFF, returns, Method(**method), PAIR)
    return games.explain(*given, reason)


def of_setting(table, values, again=False):
    """The rows of a table that are of a setting."""
    same = np.all([table[name] == value for name, value in values.items()], axis=0)
    return table[same & (table["again"] == again)]


def all_on(table):
    return of_setting(table, {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05})


def test_it_is_the_sample_covariance_of_the_runs_without_a_floor():
    runs = runs_table()
    found = explain(runs, covariance_floor_rotation=1.0, covariance_floor_translation=1.0)
    table = found.covariances
    assert len(table) == SETTINGS + 1 and table["again"].sum() == 1
    for row, covariance in zip(table.itertuples(), tables.covariances(table), strict=True):
        values = {name: getattr(row, name) for name in OFF}
        xi = of_setting(runs, values, row.again)[XI].to_numpy()
        np.testing.assert_allclose(covariance, np.cov(xi.T), rtol=1e-9, atol=1e-18)
    assert (table["n_runs"] == 100).all() and (table["n_used"] == 100).all()


def test_the_pose_that_it_stands_at_is_the_true_one():
    table = explain(runs_table()).covariances
    poses = table[TRANSFORM].to_numpy().reshape(-1, 4, 4)
    np.testing.assert_array_equal(poses, np.broadcast_to(T_REFERENCE_SOURCE, poses.shape))
    assert (table[["sequence", "reference", "source"]] == ["room", 0, 1]).all(axis=None)


@pytest.mark.parametrize("divergence", ["kl", "symmetric_kl"])
def test_its_runs_are_those_of_f(divergence):
    found = explain(
        runs_table(wrong=(3, 8), failed=[(0, 1), (7, 5)]),
        divergence=divergence,
        wrong_basins="leave_out",
    )
    columns = [*OFF, "again", "n_used"]
    assert found.covariances[columns].equals(found.uncertainty[columns])
    # The clean setting has lost 1, 3 and 8, the one with all causes on 5 as well.
    assert of_setting(found.covariances, OFF)["n_used"].item() == 97
    assert all_on(found.covariances)["n_used"].item() == 96


def test_one_of_a_reading_that_needs_none_leaves_failed_runs_out():
    found = explain(runs_table(failed=[(7, 5)]), divergence="wrong_basin_share")
    assert all_on(found.uncertainty)["n_used"].item() == 100
    assert all_on(found.covariances)["n_used"].item() == 99


def test_estimated_covariances_are_averaged_over_the_draws():
    estimates = estimates_table(3, scale=lambda draw: 1.0 + draw)
    row = all_on(explain(None, estimates, COVARIANCES).covariances)
    (found,) = tables.covariances(row)
    values = {name: row[name].item() for name in OFF}
    np.testing.assert_allclose(found, 2 * covariance_of(values), rtol=1e-12)


def test_estimated_covariances_add_to_that_of_the_samples():
    runs = runs_table()
    row = all_on(explain(runs, estimates_table(), BOTH).covariances)
    (found,) = tables.covariances(row)
    scatter = np.cov(all_on(runs)[XI].to_numpy().T)
    values = {name: row[name].item() for name in OFF}
    np.testing.assert_allclose(found, scatter + covariance_of(values), rtol=1e-9)


def test_each_replicate_has_its_own():
    table = explain(runs_table(replicates=2)).covariances
    assert table.groupby("replicate").size().to_dict() == {0: SETTINGS + 1, 1: SETTINGS + 1}
    first, second = tables.covariances(all_on(table))
    assert not np.array_equal(first, second)


def test_too_few_runs_have_none():
    table = explain(runs_table(n=40)).covariances
    assert np.isnan(tables.covariances(table)).all()


def test_a_pair_that_was_not_registered_has_none_and_says_why():
    table = explain(None, reason="no overlap").covariances
    assert len(table) == SETTINGS
    assert np.isnan(tables.covariances(table)).all()
    assert (table["reason"] == "no overlap").all()
