"""From a diagnosis to the game that explains it: which pair is run, at which levels."""

from dataclasses import replace

import corridors
import numpy as np
import pandas as pd
import pytest

from icpshap import causes, tables
from icpshap.diagnosis import here
from icpshap.diagnosis.curves import AS_DIAGNOSED
from icpshap.presets import PAPER

OTHER = (4, 5)
PAIR = {"sequence": "corridor", "reference": 2, "source": 3, "against": "other pairs"}
PAIR |= {"healthiest_reference": 4, "healthiest_source": 5, "verdict": "found"}
NOTHING = dict.fromkeys([f"level_{name}" for name in causes.shown()], 0.0)
NOISE = {**PAIR, **NOTHING, "level_sensor_noise": 0.03}
ESTIMATOR = PAPER.with_options(subsampling_probability=0.5, **AS_DIAGNOSED).estimator


def row(**changes):
    return next(pd.DataFrame([{**NOISE, **changes}]).itertuples())


def applied(found, pair, minimum_overlap=0.1, estimator=ESTIMATOR):
    return here.applied(found, lambda _: pair, estimator, corridors.streams(4), minimum_overlap)


def test_the_levels_that_were_found_are_played_on_the_pair_they_were_found_on():
    found = here.instance(row(), {"initial_pose": 4.0})
    assert found.played == OTHER and found.reason == ""
    assert found.levels == {
        "sensor_noise": 0.03,
        "initial_pose": 4.0,
        "partial_overlap": 0.0,
        "under_constrained": 0.0,
    }
    assert list(found.levels) == [cause.name for cause in causes.named(found.levels)]


def test_without_another_pair_it_is_the_pair_itself_and_nothing_is_known_of_other_causes():
    alone = {"against": "data sheet", "healthiest_reference": -1, "healthiest_source": -1}
    unknown = {"level_partial_overlap": np.nan, "level_under_constrained": np.nan}
    found = here.instance(row(**alone, **unknown), {})
    assert found.played == (2, 3) and found.reason == ""
    assert found.levels["partial_overlap"] == found.levels["under_constrained"] == 0


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"verdict": "nothing"}, "nothing stands out beside the other pairs"),
        (
            {"verdict": "nothing", "against": "data sheet"},
            "nothing stands out beside the scanner's data sheet",
        ),
        ({"verdict": "unknown"}, "not diagnosed: its scans show nothing, or there is no other"),
    ],
)
def test_what_does_not_stand_out_is_not_explained_and_the_told_causes_neither(changes, reason):
    columns = here.instance(row(**NOTHING, **changes), {"initial_pose": 4.0}).columns
    assert columns["reason"].startswith(reason)
    assert (columns["played_reference"], columns["played_source"]) == (-1, -1)
    assert columns["initial_pose"] == 1 and columns["sensor_noise"] == 0


def test_of_two_causes_that_cannot_be_told_apart_the_likelier_is_played():
    found = here.instance(row(verdict="undecided"), {})
    assert found.levels["sensor_noise"] == 0.03 and found.reason == ""


def test_levels_that_do_not_fit_the_other_pair_are_a_reason_and_no_crash():
    pair = corridors.pair(4)
    assert applied(here.instance(row(), {}), pair).reason == ""
    much = here.instance(row(level_partial_overlap=1.0), {})
    said = applied(much, replace(pair, overlapping=pair.overlapping & (pair.source[:, 0] > 0)))
    assert "cannot be applied to the pair 4-5 that it would be played on: partial_overlap" in (
        said.reason
    )
    assert "\n" not in said.reason and said.levels == much.levels
    few = here.instance(row(level_under_constrained=0.997, level_partial_overlap=0.6), {})
    sparse = PAPER.with_options(subsampling_probability=0.005, **AS_DIAGNOSED).estimator
    assert "expected at least 50" in applied(few, pair, estimator=sparse).reason
    apart = applied(here.instance(row(), {}), pair, minimum_overlap=2.0)
    assert apart.reason.startswith("the overlap ratio of the pair 4-5 that it would be played on")


def test_the_table_says_what_is_played_of_each_pair(tmp_path):
    usual = {**NOISE, **NOTHING, "reference": 0, "source": 1, "verdict": "nothing"}
    diagnosis = pd.DataFrame([usual, NOISE])
    told = {"icp_randomness": 2.0}
    given = (told, lambda _: corridors.pair(4), ESTIMATOR, lambda _: corridors.streams(4), 0.1)
    found = pd.DataFrame([here.row_of(diagnosed, *given) for diagnosed in diagnosis.itertuples()])
    plan = {"levels": told, "measured": causes.shown()}
    path = tmp_path / "instances.parquet"
    tables.write(path, found, "instances", plan, [*told, *causes.shown()])
    again = tables.read(path, "instances")
    assert list(again.played_reference) == [-1, 4]
    assert list(again.icp_randomness) == [1, 2] and list(again.sensor_noise) == [0, 0.03]
