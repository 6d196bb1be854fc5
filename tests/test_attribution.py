"""The attribution benchmark counts as it says."""

import json

import numpy as np
import pytest

from benchmarks.attribution import __main__ as attribution
from benchmarks.attribution import injector, real
from benchmarks.attribution.effects import Effects
from benchmarks.attribution.score import Score, share_of_best_drop


def test_a_share_has_wilsons_interval():
    score = Score()
    for right in [True] * 9 + [False]:
        score.count(right, ("single", "all"))
    assert score.share(("single", "all")) == pytest.approx((0.9, 0.596, 0.982), abs=1e-3)
    assert np.isnan(score.share(("mixture", "all"))).all()
    assert score.rows() == [["single", "all", 10, 0.9, 0.596, 0.982]]


@pytest.mark.parametrize(
    ("named", "share"), [("noise", 1.0), ("overlap", 0.5), (None, 0.0), ("pose", 0.0)]
)
def test_the_drop_is_a_share_of_the_best(named, share):
    assert share_of_best_drop(named, {"noise": 0.8, "overlap": 0.4, "pose": -0.1}) == share


def test_a_cause_without_an_effect_is_no_label():
    pose = np.eye(4)
    assert Effects(-5.0, {"noise": 0.1, "overlap": 0.02}, pose).first is None
    found = Effects(-5.0, {"noise": 0.9, "overlap": 0.2}, pose)
    assert found.first == "noise" and found.margin == pytest.approx(0.7)


def test_what_was_not_run_is_null():
    values = attribution._json(attribution.Counts())
    keys = "single_cases single_top1 single_top1_low unknown_top1 mixture_top1 mixture_ceiling"
    assert set(keys.split()) | {"mixture_drop", "false_alarms"} <= set(values)
    assert values["single_cases"] == 0 and values["single_top1"] is None
    json.dumps(values, allow_nan=False)


def test_what_a_robot_knows_is_told_and_not_counted():
    counts = attribution.Counts()
    case = injector.Case(None, 0, {"initial_pose": 8.0}, 0, 1)
    attribution._count(case, "single", [], ["diagnosis"], counts)
    assert counts.told == 1 and not counts.scores["diagnosis"].number


def test_real_levels_lie_within_the_ranges():
    for mechanism in (*injector.MEASURED, *injector.UNKNOWN):
        cause = injector.UNKNOWN.get(mechanism, mechanism)
        low, high = injector.RANGES[cause]
        for share in real.SHARES:
            level = real._level(mechanism, share)
            assert low < (level if cause == "sensor_noise" else 1 - level) < high
