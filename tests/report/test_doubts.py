"""Warnings say what the tables hold, the gravest first, each with what to do, none twice."""

import pytest
from known_results import FIXED, PAIRS, STUDY, shap_table, without_value

from icpshap.report import doubts
from icpshap.report.study import pairs_of

FLOOR = "the floor makes up 90% of the clean variance in one direction"
STOP = "the initial pose explains 71% of the clean variance of a component: it shows where the "
STOP += "iteration stops"
GAUSSIAN = "two clean samples differ by 1.1, more than Gaussian ones would: a few runs make up the "
GAUSSIAN += "covariance"


@pytest.mark.parametrize(
    "remark, kind",
    [
        ("the ground truth looks wrong, or the scans hardly overlap: at it", "truth"),
        ("the overlap ratio is 1.20, above 1: the source has more points", "counting"),
        ("only 40 runs left, fewer than 50: no value", "no_value"),
        ("only 3 noise draws left (their covariance failed), fewer than 5: no value", "no_value"),
        ("the share needs pose samples, which the estimator does not return: no value", "no_value"),
        (STOP, "unconverged"),
        (FLOOR, "floor"),
        (GAUSSIAN, "few_decide"),
        ("up to 3 of 12 sigma points of a setting end in another basin, and each", "basins"),
        ("fewer than 50 runs are never in a wrong basin: no value without those", "basins"),
        ("one noise draw is left: no interval, and no correction of the bias", "intervals"),
        ("what nobody knows", "other"),
    ],
)
def test_each_remark_is_of_a_kind(remark, kind):
    assert doubts.kind_of(remark) == kind


def test_every_kind_but_the_rest_says_what_to_do():
    assert all(kind.advice.endswith(".") for name, kind in doubts.KINDS.items() if name != "other")


def test_values_are_told_with_and_without_wrong_basins(grid):
    (text,) = doubts.warnings(grid.assign(n_wrong_basin=3), STUDY)
    assert "Runs in a wrong basin in a setting of an instance: 3 of 100 in the median, at" in text
    both = STUDY.present(grid, STUDY.players[0]).phi_sensor_noise.median() + 0.25
    assert f"Median φ with and without such runs: sensor noise {both:.2f} and {both:.2f}" in text
    alone = STUDY.instance(grid, STUDY.waterfall).assign(n_wrong_basin=3)
    (text,) = doubts.warnings(alone, STUDY)
    assert text.startswith("Runs in a wrong basin in a setting: 3 of 100; kept. φ with and without")


def test_the_floor_comes_with_the_sensitivity_to_it(grid):
    first, second = doubts.warnings(grid.assign(warning=FLOOR), STUDY)
    assert first == f"Apartment 6–7 ({len(grid)} instances): {FLOOR}."
    assert "sensor noise 0.25 and 0.25" in second


def test_a_pair_whose_clean_samples_differ_is_told_once(grid):
    assert doubts.warnings(grid, STUDY) == []
    for warning, far in (("", ""), (GAUSSIAN, ", and in Apartment 6–7 by far")):
        (line,) = doubts.warnings(grid.assign(f_again=364.68, warning=warning), STUDY)
        assert line == (
            f"Two clean samples differ by more than the noise floor{far}, f = 364.68 nats: an f of "
            "that size need not come from any cause."
        )
    table = shap_table(FIXED, PAIRS)
    table["f_again"] = [0.3, 0.9, 0.4]
    (line,) = doubts.warnings(table, STUDY)
    assert line.startswith("2 of 3 pairs: two clean samples differ")
    assert "f = 0.90 nats at most" in line


def test_the_gravest_come_first_each_remark_once():
    table = without_value(shap_table(FIXED, PAIRS), [1], "overlap ratio 0.08 is not above 0.1")
    table = table.assign(warning=[f"{FLOOR}; {STOP}", "", STOP], n_failed=[0, 0, 2])
    pairs = pairs_of(table).assign(warning=["", "", "the ground truth looks wrong: no motion"])
    found = [*doubts.of_table(table, STUDY), *doubts.of_pairs(pairs, STUDY)]
    groups = doubts.grouped([("one", doubt) for doubt in found])
    kinds = {kind.title: name for name, kind in doubts.KINDS.items()}
    names = [kinds[group.title] for group in groups]
    assert names == ["truth", "not_registered", "unconverged", "floor", "failed"]
    (stop,) = groups[2].lines
    assert stop == ("one", f"Apartment 0–1, ETH 0–1 (2 instances): {STOP}.")
    assert groups[1].lines[0][1].endswith("Apartment 1–2 (overlap ratio 0.08 is not above 0.1).")
    assert groups[4].lines[0][1].startswith("1 instance has runs that failed, at most 2 of 100")


def test_nothing_is_said_twice_of_a_scope():
    doubt = doubts.Doubt("other", "twice")
    (group,) = doubts.grouped([("one", doubt), ("one", doubt), ("two", doubt)])
    assert group.lines == [("one", "twice"), ("two", "twice")]


def test_a_table_without_rows_has_no_doubts(grid):
    assert doubts.of_table(grid.iloc[:0], STUDY) == []
    assert doubts.grouped([]) == []


def test_a_remark_on_several_pairs_is_told_once():
    pairs = pairs_of(shap_table(FIXED, PAIRS)).assign(warning=["poses registered"] * 2 + ["other"])
    assert [doubt.text for doubt in doubts.of_pairs(pairs, STUDY)] == [
        "Apartment 0–1, Apartment 1–2: poses registered.",
        "ETH 0–1: other.",
    ]
