"""A study knows its players and its figures, whatever they are called, and the rows that count."""

import numpy as np
import pytest
from known_results import (
    OF_NUMBER,
    SEVEN,
    STUDY,
    THREE,
    fixed_of,
    grid_of,
    of_covariances,
    plugged_in,
    study_of,
    without_value,
)

from icpshap import causes, estimators
from icpshap.report import words
from icpshap.report.study import Study, contains_zero, judged


def test_registries_are_restored():
    before = list(causes.CAUSES), list(estimators.KINDS)
    with pytest.raises(RuntimeError), plugged_in():
        raise RuntimeError
    assert (list(causes.CAUSES), list(estimators.KINDS)) == before


@pytest.mark.parametrize("number", OF_NUMBER)
def test_players_are_the_causes_in_the_order_of_the_registry(number):
    study = study_of(OF_NUMBER[number])
    assert [cause.name for cause in study.players] == list(OF_NUMBER[number])


def test_a_study_comes_as_plain_data():
    plain = STUDY.__dict__ | {"causes": list(THREE), "dependence": [["sensor_noise", THREE[1]]]}
    study = Study(**plain)
    assert [c.name for c in study.players] == list(THREE)
    (couple,) = study.dependence_figures.values()
    assert [c.name for c in couple] == ["sensor_noise", "initial_pose"]


def test_names_of_figures_are_those_of_the_couples_and_not_split():
    study = study_of(SEVEN, dependence=[("error", "error_by_range"), ("error_by_range", "error")])
    found = {
        name: tuple(cause.name for cause in couple)
        for name, couple in study.dependence_figures.items()
    }
    assert found == {
        "dependence_error_by_error_by_range": ("error", "error_by_range"),
        "dependence_error_by_range_by_error": ("error_by_range", "error"),
    }


@pytest.mark.parametrize(
    "kind, repeats",
    [("monte_carlo", "runs"), ("closed_form", "noise draws"), ("particles", "samples")],
)
def test_only_exchangeable_samples_are_runs(kind, repeats):
    assert study_of(THREE, kind=kind).repeats == repeats


def test_what_is_never_on_is_not_shown():
    table = fixed_of(THREE).assign(initial_pose=1.0)
    assert [cause.name for cause in STUDY.shown(table)] == ["sensor_noise", "partial_overlap"]
    assert STUDY.phi(table) == ["phi_sensor_noise", "phi_partial_overlap"]


def test_present_needs_every_cause_and_a_value():
    table = without_value(grid_of(THREE), [17], "too little overlap")
    noise, pose, _ = STUDY.players
    rows = STUDY.present(table, noise, pose)
    expected = (table.sensor_noise > 0) & (table.initial_pose > 1) & (table.index != 17)
    assert rows.index.tolist() == table.index[expected].tolist()


def test_an_interval_that_is_missing_contains_nothing():
    table = fixed_of(("sensor_noise",))
    table["phi_sensor_noise_low"] = [-1.0, 1.0, np.nan]
    table["phi_sensor_noise_high"] = [1.0, 2.0, np.nan]
    assert contains_zero(table, "phi_sensor_noise").tolist() == [True, False, False]
    assert judged(table, "phi_sensor_noise").index.tolist() == [0, 1]


def test_intervals_are_those_of_the_rows_with_values():
    table = fixed_of(THREE)
    assert STUDY.interval_over(without_value(table, [0], "too little overlap")) == "runs"
    assert STUDY.interval_over(without_value(table, table.index, "too little overlap")) == ""
    assert STUDY.interval_over(of_covariances(table)) == ""


def test_words():
    assert words.number(3.14159) == "3.14" and words.number(-54321.0) == "-54300"
    assert words.number(2.55e5) == "2.55e+05" and words.number(-0.001) == "0.00"
    assert words.with_interval(1.0, 0.5, 1.5) == "1.00 [0.50, 1.50]"
    assert words.with_interval(1.0, np.nan, np.nan) == "1.00"
    assert words.listed(["a"]) == "a" and words.listed("abc") == "a, b and c"
    assert words.titles(["partial_overlap", "sensor_noise"]) == ["partial overlap", "sensor noise"]
    values = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
    said = "sensor noise σ = 0.05 m, initial pose scale s = 1.5, partial overlap λ = 0.05"
    assert words.describe_values(values, STUDY.players) == said
    assert not words.is_huge([]) and not words.is_huge([np.nan]) and words.is_huge([-2e3, np.nan])
