"""W, the share of runs in a wrong basin: its intervals always have a width."""

import itertools

import numpy as np
import pytest
from known_pair import PAIR
from known_runs import OFF, estimates_table, instances, runs_table
from scipy.stats import binomtest

from icpshap.estimators.kind import COVARIANCES, SAMPLES
from icpshap.explanation import games, intervals
from icpshap.explanation.method import Method

NAMES = list(OFF)
WRONG = [3, 60]


def explain(runs, estimates=None, returns=SAMPLES, full=False, **method):
    given = (runs, estimates, instances(full=full), OFF, returns, Method(**method), PAIR)
    return games.explain(*given)


def shifted(runs, on, number):
    """The runs with the first `number` in another basin where the marked rows say so."""
    runs = runs.copy()
    runs.loc[on & (runs["run"] < number), "xi_3"] += 0.6
    return runs


def test_wilsons_interval():
    quantile = 1.959963984540054
    expected = binomtest(7, 100).proportion_ci(method="wilson")
    np.testing.assert_allclose(intervals.wilson(0.07, 100, quantile), expected, 1e-9)
    assert intervals.wilson(np.array([0.0]), 100, quantile)[0] == 0
    assert intervals.wilson(np.array([1.0]), 100, quantile)[1] == 1


def test_a_share_counts_failed_runs_too():
    uncertainty = explain(runs_table(wrong=WRONG, failed=[(0, 5), (0, 6)])).uncertainty
    clean = uncertainty.iloc[0]
    assert clean["wrong_basin_share"] == 0.04
    assert clean["wrong_basin_share_low"] < 0.04 < clean["wrong_basin_share_high"]


def test_a_cause_that_makes_wrong_basins_gets_them():
    runs = runs_table()
    row = explain(shifted(runs, runs["initial_pose"] > 1, 20)).shap.iloc[0]
    assert (row["clean_wrong_basin_share"], row["wrong_basin_share"]) == (0.0, 0.2)
    for part in ("wrong_basin", "wrong_basin_removal"):
        assert row[f"{part}_initial_pose"] == pytest.approx(0.2)
        assert 0.1 < row[f"{part}_initial_pose_low"] < row[f"{part}_initial_pose_high"] < 0.3
    assert row["wrong_basin_sensor_noise"] == 0


def test_where_no_mark_varies_the_interval_is_three_runs_wide():
    table = explain(runs_table(wrong=WRONG), full=True).shap
    row = table.iloc[-1]
    for name in NAMES:
        ends = [row[f"wrong_basin_{name}{end}"] for end in ("_low", "", "_high")]
        assert ends == pytest.approx([-0.03, 0.0, 0.03])
    off = table[table["sensor_noise"] == 0]
    interval = off[["wrong_basin_sensor_noise_low", "wrong_basin_sensor_noise_high"]]
    assert (interval == 0).all(axis=None)


def test_with_replicates_too_no_interval_is_a_point():
    row = explain(runs_table(replicates=3)).shap.iloc[0]
    for name in NAMES:
        for part in ("wrong_basin", "wrong_basin_removal"):
            ends = [row[f"{part}_{name}{end}"] for end in ("_low", "", "_high")]
            assert ends == pytest.approx([-0.01, 0.0, 0.01])
    assert row["wrong_basin_share_low"] == 0
    # Wilson's interval of 300 runs, with Student's t of three replicates.
    assert row["wrong_basin_share_high"] == pytest.approx(0.0581, abs=1e-4)


def test_replicates_that_differ_widen_the_interval():
    runs = runs_table(replicates=3)
    alike = shifted(runs, runs["initial_pose"] > 1, 15)
    apart = shifted(runs, (runs["initial_pose"] > 1) & (runs["replicate"] == 0), 45)
    found = [explain(table).shap.iloc[0] for table in (alike, apart)]
    for row in found:
        assert row["wrong_basin_share"] == pytest.approx(0.15)
    width = [row["wrong_basin_share_high"] - row["wrong_basin_share_low"] for row in found]
    assert width[1] > 2 * width[0]


def test_draws_that_differ_widen_the_interval():
    runs = runs_table(noise_draws=10)
    alike = shifted(runs, runs["run"] % 10 == 0, 100)
    apart = shifted(runs, runs["noise_draw"] == 0, 100)
    width = []
    for table in (alike, apart):
        row = explain(table).uncertainty.iloc[0]
        assert row["wrong_basin_share"] == pytest.approx(0.1)
        width.append(row["wrong_basin_share_high"] - row["wrong_basin_share_low"])
    assert width[1] > 2 * width[0]


def test_without_a_basin_there_is_no_share():
    runs = runs_table()
    on = (runs["sensor_noise"] > 0).to_numpy()
    runs.loc[on, "xi_3"] += 1.0 * (runs["run"][on] // 30)
    explained = explain(runs)
    row = explained.shap.iloc[0]
    assert row["no_basin"] and np.isnan(row["wrong_basin_share"])
    assert np.isnan(row[[f"wrong_basin_{name}" for name in NAMES]].astype(float)).all()
    assert row["clean_wrong_basin_share"] == 0
    settings = explained.uncertainty
    assert settings["no_basin"].tolist() == [*[False] * 4, *[True] * 4, False]


def test_where_every_run_failed_all_are_lost():
    """That is known: the share is 1, and not unknown."""
    runs = runs_table(failed=[(7, run) for run in range(100)])
    explained = explain(runs, divergence="wrong_basin_share")
    row = explained.shap.iloc[0]
    assert row["f"] == row["wrong_basin_share"] == 1 and not row["no_basin"]
    assert row["wrong_basin_share_low"] < 1 == row["wrong_basin_share_high"]
    assert sum(row[f"wrong_basin_{name}"] for name in NAMES) == pytest.approx(1)


@pytest.mark.parametrize("divergence", ["wrong_basin_share", "log_error"])
def test_as_f_they_share_out_what_they_are(divergence):
    runs = runs_table(failed=[(7, 5)])
    runs = shifted(runs, runs["initial_pose"] > 1, 20)
    row = explain(runs, divergence=divergence, wrong_basins="leave_out").shap.iloc[0]
    phi = row[[f"phi_{name}" for name in NAMES]].astype(float)
    assert row["base_value"] + phi.sum() == pytest.approx(row["f"])
    assert row["f_low"] <= row["f"] <= row["f_high"]
    assert phi.idxmax() == "phi_initial_pose" if divergence == "wrong_basin_share" else True
    assert row["n_used"] == (100 if divergence == "wrong_basin_share" else 99)


@pytest.mark.parametrize("replicates", [1, 3])
@pytest.mark.parametrize("number", [0, 20])
def test_as_f_a_share_has_the_interval_that_it_has_beside_others(replicates, number):
    runs = runs_table(replicates=replicates)
    runs = shifted(runs, runs["initial_pose"] > 1, number)
    explained = explain(runs, divergence="wrong_basin_share")
    row = explained.shap.iloc[0]
    names = {"f": "wrong_basin_share"}
    names |= {f"phi_{name}": f"wrong_basin_{name}" for name in NAMES}
    names |= {f"removal_{name}": f"wrong_basin_removal_{name}" for name in NAMES}
    for a, b in itertools.combinations(NAMES, 2):
        assert row[f"interaction_{a}_{b}_low"] < row[f"interaction_{a}_{b}_high"]
    for as_f, beside in names.items():
        for end in ("", "_low", "_high"):
            assert row[as_f + end] == pytest.approx(row[beside + end], abs=1e-12)
        assert row[f"{as_f}_low"] < row[f"{as_f}_high"]
    assert row["phi_initial_pose_significant"] == (number > 0)
    settings = explained.uncertainty
    for end in ("", "_low", "_high"):
        np.testing.assert_allclose(settings[f"f{end}"], settings[f"wrong_basin_share{end}"])


@pytest.mark.parametrize("divergence", ["wrong_basin_share", "log_error"])
def test_covariances_alone_have_neither(divergence):
    explained = explain(None, estimates_table(), COVARIANCES, divergence=divergence)
    row = explained.shap.iloc[0]
    assert np.isnan(row["f"]) and np.isnan(row["wrong_basin_share"])
    assert "needs pose samples, which the estimator does not return" in row["warning"]
    assert np.isfinite(row["entropy_difference"])
