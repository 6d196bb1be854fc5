"""Medians, outlier rules and the order of the causes, with their probabilities."""

import csv
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from icpshap.errors import UserError
from icpshap.explanation import ranking

REFERENCE = Path(__file__).parents[2] / "reference"
CAUSES = ["sensor_noise", "initial_pose", "partial_overlap"]
ORDER = ["sensor_noise", "partial_overlap", "initial_pose"]
PHI = [f"phi_{name}" for name in CAUSES]
CLEAR = (10.0, 1.0, 3.0)


def tables(centre, pairs=12, spread=0.5, noise=0.3, resamples=50, sequence="room", seed=0):
    """shap and resampled table of pairs whose values spread about the centre."""
    generator = np.random.default_rng(seed)
    phi = centre + generator.normal(size=(pairs, 3)) * spread
    phi += generator.normal(size=(pairs, 3)) * noise
    again = phi[:, None] + generator.normal(size=(pairs, resamples, 3)) * noise
    shap = pd.DataFrame(phi, columns=PHI).assign(instance=0)
    shap["reference"] = np.arange(pairs)
    rows = pd.DataFrame(again.reshape(-1, 3), columns=PHI).assign(instance=0)
    rows["reference"] = np.repeat(np.arange(pairs), resamples)
    rows["resample"] = np.tile(np.arange(resamples), pairs)
    return [
        frame.assign(sequence=sequence, source=frame["reference"] + 1) for frame in (shap, rows)
    ]


def rank(shap, resampled, causes=CAUSES, **options):
    table = ranking.ranking_table(shap, resampled, causes, **{"order": ORDER} | options)
    rule = "iqr" if "iqr" in set(table["outlier_rule"]) else "none"
    return table[table["outlier_rule"] == rule].set_index("sequence")


def test_the_one_phi_of_a_sequence_has_one_interval():
    """Not a second one as the median of one value."""
    shap, resampled = tables(CLEAR, pairs=1)
    for phi in PHI:
        shap[f"{phi}_low"], shap[f"{phi}_high"] = shap[phi] - 0.25, shap[phi] + 0.5
    table = ranking.ranking_table(shap, resampled, CAUSES)
    for name in CAUSES:
        value = shap[f"phi_{name}"].item()
        found = table.loc[
            table["outlier_rule"] == "none", [f"median_{name}{e}" for e in ("", "_low", "_high")]
        ]
        assert found.to_numpy()[0] == pytest.approx([value, value - 0.25, value + 0.5])


def test_a_clear_order_is_probable():
    row = rank(*tables(CLEAR)).loc["room"]
    assert row["order"] == "sensor_noise > partial_overlap > initial_pose"
    assert row["probability"] == 1.0
    assert row["p"] == row["p_holm"] == pytest.approx(1 / 2001)


def test_another_order_is_improbable():
    row = rank(*tables((10.0, 3.0, 1.0))).loc["room"]
    assert row["probability"] == 0.0
    assert row["p"] == 1.0


def test_the_weakest_step_decides():
    row = rank(*tables((10.0, 2.0, 2.0))).loc["room"]
    assert 0.05 < row["p"] < 0.95
    assert row["probability"] == pytest.approx(1 - row["p"], abs=0.01)


def test_the_order_is_restricted_to_the_causes_that_are_there():
    shap, resampled = tables(CLEAR)
    row = rank(shap, resampled, ["sensor_noise", "initial_pose"]).loc["room"]
    assert row["order"] == "sensor_noise > initial_pose"
    assert row["probability"] == 1.0
    assert "median_partial_overlap" not in row


@pytest.mark.parametrize(
    "causes, order", [(["sensor_noise"], ORDER), (CAUSES, ORDER[:1]), (CAUSES, [])]
)
def test_fewer_than_two_causes_have_no_order(causes, order):
    row = rank(*tables(CLEAR), causes, order=order).loc["room"]
    assert row[["order", "probability", "p", "p_holm"]].isna().all()
    assert np.isfinite(row["median_sensor_noise"])


def test_median_is_that_of_the_pairs_left_and_lies_in_its_interval():
    shap, resampled = tables(CLEAR)
    shap.loc[4, "phi_initial_pose"] = 50.0
    row = rank(shap, resampled).loc["room"]
    assert (row["n_pairs"], row["n_rows"], row["n_removed"]) == (12, 12, 1)
    for name in CAUSES:
        assert row[f"median_{name}"] == pytest.approx(shap.drop(index=4)[f"phi_{name}"].median())
        low, high = row[f"median_{name}_low"], row[f"median_{name}_high"]
        assert low < row[f"median_{name}"] < high


def test_interval_of_the_median_covers_the_truth():
    inside = np.zeros(3)
    for seed in range(60):
        row = rank(*tables(CLEAR, pairs=30, seed=seed)).loc["room"]
        for a, name in enumerate(CAUSES):
            inside[a] += row[f"median_{name}_low"] <= CLEAR[a] <= row[f"median_{name}_high"]
    assert (inside >= 53).all()  # a binomial's 2 % quantile at 0.95


def test_neighbouring_pairs_are_drawn_together():
    """Values that come in equal neighbours: a median of blocks varies more than one of pairs."""

    def width(values):
        draws = np.array(values, dtype=float)[None, :, None, None]
        medians = ranking.bootstrap_medians(draws, "none", np.random.default_rng(0))
        return medians.std()

    assert width(np.repeat(np.arange(20), 2)) > 1.2 * width(
        np.random.default_rng(0).permutation(np.repeat(np.arange(20), 2))
    )


def test_outlier_rules():
    values = np.array([[1.0], [2.0], [3.0], [4.0], [6.6], [-8.0]])
    # Quartiles 1.25 and 3.75: rows stay in [-2.5, 7.5]; without the negative row [-1, 7].
    assert ranking.kept_rows(values, "none").all()
    assert ranking.kept_rows(values, "iqr").tolist() == [True] * 5 + [False]
    assert ranking.kept_rows(values, "positive_then_iqr").tolist() == [True] * 5 + [False]
    values[4] = 7.2
    assert ranking.kept_rows(values, "iqr")[4]
    assert not ranking.kept_rows(values, "positive_then_iqr")[4]


def test_a_row_goes_if_any_of_its_columns_is_an_outlier():
    values = np.tile(np.arange(9.0)[:, None], 3)
    values[2, 1] = 40.0
    assert np.flatnonzero(~ranking.kept_rows(values, "iqr")).tolist() == [2]


def test_quantiles_are_numpys_over_the_kept_rows():
    values = np.random.default_rng(0).normal(size=(4, 11, 3))
    kept = np.random.default_rng(1).random((4, 11)) < 0.6
    found = ranking.quantiles(values, kept, [0.25, 0.5])
    for k in range(4):
        expected = np.quantile(values[k][kept[k]], [0.25, 0.5], axis=0)
        np.testing.assert_allclose(found[:, k], expected)


def test_all_three_outlier_rules_are_reported():
    shap, resampled = tables(CLEAR)
    shap.loc[3, "phi_partial_overlap"] = -0.5
    table = ranking.ranking_table(shap, resampled, CAUSES).set_index("outlier_rule")
    assert table.index.tolist() == ["none", "iqr", "positive_then_iqr"]
    assert table.loc["none", "n_removed"] == 0
    assert table.loc["positive_then_iqr", "n_removed"] >= 1


def test_holm():
    """The example of Holm's step-down: 0.01, 0.04, 0.03, 0.005 give 0.03, 0.06, 0.06, 0.02."""
    found = ranking.holm([0.01, 0.04, np.nan, 0.03, 0.005])
    np.testing.assert_allclose(found, [0.03, 0.06, np.nan, 0.06, 0.02])


def test_p_is_corrected_for_the_number_of_sequences():
    one, two = tables(CLEAR), tables(CLEAR, sequence="stairs", seed=1)
    both = [pd.concat(frames, ignore_index=True) for frames in zip(one, two, strict=True)]
    table = rank(*both)
    assert table.index.tolist() == ["room", "stairs"]
    np.testing.assert_allclose(table["p_holm"], 2 * table["p"])


def test_the_papers_values_stand_beside_ours():
    paper = pd.DataFrame(
        {"sequence": ["room"], "sensor_noise": [10.1], "initial_pose": [7.0]}
    ).assign(partial_overlap=np.nan)
    row = rank(*tables(CLEAR), paper=paper).loc["room"]
    assert row["paper_initial_pose"] == 7.0
    assert row["paper_sensor_noise_inside"]
    assert not row["paper_initial_pose_inside"]
    assert np.isnan(row["paper_partial_overlap"])
    assert not row["paper_partial_overlap_inside"]


def test_pairs_without_values_do_not_count():
    shap, resampled = tables(CLEAR)
    shap.loc[5, PHI] = np.nan
    row = rank(shap, resampled[resampled["reference"] != 5]).loc["room"]
    assert row["n_pairs"] == 11
    nothing = rank(shap[shap["reference"] == 5], resampled[:0]).loc["room"]
    assert nothing["n_pairs"] == nothing["n_rows"] == 0
    assert nothing[["median_sensor_noise", "probability", "p", "p_holm"]].isna().all()


def test_statistics_of_pairs_appear_from_five_on():
    few = ranking.ranking_table(*tables(CLEAR, pairs=4), CAUSES, order=ORDER)
    assert few["outlier_rule"].tolist() == ["none"]
    (row,) = few.to_dict(orient="records")
    assert row["warning"].startswith("4 pairs with values, fewer than 5: too few to see how")
    assert few[["order", "probability", "p", "p_holm"]].isna().all(axis=None)
    assert np.isfinite(row["median_sensor_noise"])
    enough = ranking.ranking_table(*tables(CLEAR, pairs=5), CAUSES, order=ORDER)
    assert len(enough) == 3 and (enough["warning"] == "").all()
    assert enough["p_holm"].notna().all()


def test_tables_of_different_runs_are_refused():
    shap, resampled = tables(CLEAR)
    with pytest.raises(UserError, match=r"room: 12 pairs .* 11 have resamples.\nHint: make both"):
        rank(shap, resampled[resampled["reference"] != 5])


def test_reference_values_are_complete():
    table = pd.read_csv(REFERENCE / "table1.csv").set_index("sequence")
    assert table.shape == (8, 3)
    assert table.loc["apartment", "sensor_noise"] == 35.571175
    # The paper: sensor noise > partial overlap > initial pose except in Mountain.
    follows = (table["sensor_noise"] > table["partial_overlap"]) & (
        table["partial_overlap"] > table["initial_pose"]
    )
    assert follows.index[~follows].tolist() == ["mountain"]
    with (REFERENCE / "figures.csv").open() as file:
        waterfall = {
            row["quantity"]: float(row["low"])
            for row in csv.DictReader(file)
            if row["figure"] == "waterfall"
        }
    assert sum(waterfall[phi] for phi in PHI) == pytest.approx(waterfall["f"], abs=0.01)
