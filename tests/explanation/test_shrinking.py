"""A spread that gets smaller is told from one that grows."""

import numpy as np
import pytest
from known_pair import PAIR
from known_runs import OFF, estimates_table, instances, runs_table

from icpshap.estimators.kind import COVARIANCES, SAMPLES
from icpshap.explanation import games
from icpshap.explanation.method import Method
from icpshap.tables import COVARIANCE, XI


def explain_one(runs, **method):
    given = (runs, None, instances(), OFF, SAMPLES, Method(**method), PAIR)
    return games.explain(*given).shap.iloc[0]


def narrowed():
    """Runs that sensor noise brings together, to a fifth."""
    runs = runs_table()
    runs[XI] *= np.where(runs["sensor_noise"] > 0, 0.05, 1.0)[:, None]
    return runs


def test_what_widens_does_not_shrink():
    row = explain_one(runs_table())
    assert not row["shrinks"] and not any(row[f"narrows_{name}"] for name in OFF)
    assert row["entropy_difference_low"] > 0


def test_an_instance_that_shrinks_and_the_cause_that_narrows_it():
    row = explain_one(narrowed())
    assert row["shrinks"] and row["entropy_difference_high"] < 0
    assert row["narrows_sensor_noise"] and not row["narrows_initial_pose"]
    assert row["phi_sensor_noise"] > 1  # the divergence counts it as uncertainty
    assert row["translation_rmse"] < row["clean_translation_rmse"]


def test_the_error_is_that_of_the_directions():
    """Of the runs that fail in no setting of the game, though one failed in one setting only."""
    runs = runs_table(wrong=[3], failed=[(7, 5), (0, 9)])
    explained = games.explain(
        runs, None, instances(), OFF, SAMPLES, Method(bias_correction="jackknife"), PAIR
    )
    row = explained.shap.iloc[0]
    errors = explained.directions.set_index("direction")
    for kind in ("translation", "rotation"):
        of_kind = errors.loc[f"error_{kind}"]
        assert row[f"{kind}_rmse"] == pytest.approx(np.sqrt(of_kind.value), rel=1e-12)
        assert row[f"clean_{kind}_rmse"] == pytest.approx(np.sqrt(of_kind.clean), rel=1e-12)


def test_parts_add_up_to_the_entropy_difference():
    row = explain_one(narrowed(), bias_correction="jackknife")
    parts = [row[f"entropy_difference_{name}"] for name in OFF]
    assert sum(parts) == pytest.approx(row["entropy_difference"])


def test_it_is_that_of_the_reading():
    by_reading = explain_one(narrowed(), divergence="entropy_difference")
    for end in ("", "_low", "_high"):
        assert by_reading[f"entropy_difference{end}"] == by_reading[f"f{end}"]


def test_a_deterministic_estimator_shrinks_without_an_interval():
    """Nothing varies in its estimates, so that the number itself counts."""
    table = estimates_table()
    table[COVARIANCE] *= np.where(table.sensor_noise > 0, 0.001, 1.0)[:, None]
    given = (None, table, instances(), OFF, COVARIANCES, Method(), PAIR)
    row = games.explain(*given).shap.iloc[0]
    assert np.isnan(row["entropy_difference_high"]) and row["entropy_difference"] < 0
    assert row["shrinks"] and row["narrows_sensor_noise"] and not row["narrows_initial_pose"]
