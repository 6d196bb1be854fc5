"""What is said where instances are diagnosed: what was found, where it is played, what to do."""

from dataclasses import replace

import pandas as pd
import pytest
from known_results import FIXED, PAIRS, STUDY, shap_table, without_value

from icpshap import causes
from icpshap.report import captions, doubts, fit, here

HERE = replace(STUDY, here=True)
USUAL = "nothing stands out beside the other pairs"
FOUND = {"verdict": "found", "causes": "sensor_noise"}
UNDECIDED = {"verdict": "undecided", "causes": "sensor_noise, partial_overlap"}


def explained(**changes):
    """Three pairs: noise matters most in the first, the start in the second, of the third nothing.

    The first two are played on another pair.
    """
    table = without_value(shap_table(FIXED, PAIRS), [2], USUAL)
    table = table.assign(played_reference=[4, 4, -1], played_source=[5, 5, -1])
    table.loc[2, list(FIXED)] = [0.0, 1.0, 0.0]
    of_first = {"sensor_noise": 3.0, "initial_pose": 1.0, "partial_overlap": 0.1}
    of_second = {"sensor_noise": 0.1, "initial_pose": 2.0, "partial_overlap": 0.1}
    for place, removals in enumerate((of_first, of_second)):
        for name, value in removals.items():
            table.loc[place, f"removal_{name}"] = value
            table.loc[place, f"removal_{name}_low"] = value - 0.5
            table.loc[place, f"removal_{name}_high"] = value + 0.5
    return table.assign(**changes)


def diagnoses(*verdicts):
    numbers = {f"{of}_{name}": 0.03 for name in causes.shown() for of in ("level", "z")}
    return pd.DataFrame(
        [
            {**dict(zip(("sequence", "reference", "source"), pair, strict=True)), **numbers, **one}
            for pair, one in zip(PAIRS, verdicts, strict=True)
        ]
    )


def test_it_is_said_where_the_levels_are_played():
    table = explained()
    assert captions.which_pairs(table, HERE) == "2 of 3 pairs of Apartment, ETH"
    assert captions.which_instances(table, HERE) == (
        "at the diagnosed levels and initial pose scale s = 1.5, played on the most usual other "
        "pair (Apartment 4–5)"
    )
    own = explained(played_reference=[0, 4, -1], played_source=[1, 5, -1])
    assert captions.which_instances(own, HERE).endswith(
        "played on the most usual other pair (Apartment 4–5) or on the pair itself, on top of what "
        "is there"
    )


def test_advice_is_by_removal_and_says_whether_it_can_be_tried():
    noise, start = here.advice(explained(), HERE)
    assert noise.startswith("f of Apartment 0–1 falls most without sensor noise. What may")
    assert "that needs new scans, and its effect is predicted, from the game on Apartment" in noise
    assert start.startswith("f of Apartment 1–2 falls most without initial pose")
    assert "that can be tried on these scans" in start


def test_what_cannot_be_told_from_zero_or_narrows_the_spread_is_no_advice():
    unsure = explained(removal_sensor_noise_low=-1.0, narrows_initial_pose=True)
    (told,) = here.advice(unsure, HERE)
    assert told.startswith("Of Apartment 0–1 and Apartment 1–2 no removal can be told from zero")


def test_the_table_has_what_was_found_and_the_removals_most_first():
    text = here.html(explained(), diagnoses(FOUND, UNDECIDED, FOUND), HERE)
    first, second = (line for line in text.splitlines() if "Apartment 4–5" in line)
    assert "sensor noise (σ = 0.03 m, +0.0 standard deviations)" in first
    assert first.index("sensor noise 3.00 [2.50, 3.50]") < first.index("initial pose scale 1.00")
    assert "sensor noise or partial overlap, of which the first is played" in second
    assert "ETH" not in text


def test_a_pair_that_is_as_the_others_is_no_doubt_and_another_reason_is():
    assert not [doubt for doubt in doubts.of_table(explained(), HERE) if "ETH" in doubt.text]
    other = explained(reason=["", "", "not diagnosed: its scans show nothing"])
    (doubt,) = [doubt for doubt in doubts.of_table(other, HERE) if "ETH" in doubt.text]
    assert doubt.kind == "not_explained"
    assert doubt.text == "Not explained: ETH 0–1 (not diagnosed: its scans show nothing)."


def test_where_nothing_stands_out_there_is_nothing_to_explain():
    none = without_value(shap_table(FIXED, PAIRS), [0, 1, 2], USUAL)
    none = none.assign(played_reference=-1, played_source=-1, wrong_basin_share=float("nan"))
    assert here.nothing(none).startswith("nothing stands out in any pair")
    assert here.advice(none, HERE) == [] and here.html(none, diagnoses(*[FOUND] * 3), HERE) == ""
    unknown = none.assign(reason=[USUAL, USUAL, "not diagnosed"])
    assert here.nothing(unknown) == ""


def test_what_breaks_the_numbers_is_said_of_the_pair_that_was_run():
    broken = explained(misfit=["Half of the runs arrive.", "", ""])
    assert "Apartment 4–5: Half of the runs arrive." in fit.misfits(broken, HERE)


@pytest.mark.parametrize("study", [STUDY, HERE])
def test_findings_of_other_experiments_are_as_they_were(study):
    table = explained().drop(columns=["played_reference", "played_source"])
    assert ("diagnosed" in captions.which_instances(table, study)) == study.here
