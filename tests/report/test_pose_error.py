"""The first sentence: the error clean and with all causes on, and which cause makes it."""

import numpy as np
import pandas as pd
import pytest
from known_results import STUDY, THREE, directions_table, study_of

from icpshap import tables
from icpshap.report import captions, pose_error

SQUARE_DEGREE = np.deg2rad(1.0) ** 2
CAUSES = ("sensor_noise", "initial_pose", "partial_overlap")


def row_of(table, name, clean, value, parts, unit, unsure=False):
    """The row of a direction with variances [unit^2], as a table of one row.

    parts: of each cause, its Shapley value and what remains without it.
    """
    growth = value - clean
    numbers = {"clean": clean, "value": value, "growth": growth}
    for cause, (part, remaining) in zip(CAUSES, parts, strict=True):
        numbers |= {f"phi_{cause}": part, f"remaining_{cause}": remaining}
    row = table[table.direction == name].iloc[:1].copy()
    for column, number in numbers.items():
        half = 2 * abs(number) if unsure else 0.1 * abs(number)
        ends = (("", 0.0), ("_low", -half), ("_high", half))
        row = row.assign(**{f"{column}{end}": unit * (number + by) for end, by in ends})
    row = row.assign(**{f"share_{c}": p / growth for c, (p, _) in zip(CAUSES, parts, strict=True)})
    return row.assign(in_per_cent=growth > 0 and not unsure)


def of_errors(clean=(0.49, 0.0036), value=(316.84, 6.25), unsure=False, **changes):
    """A table in which the error goes from 0.7 cm, 0.06 deg to 17.8 cm, 2.5 deg."""
    table = directions_table()
    rows = []
    for name, before, after, unit in (
        ("error_translation", clean[0], value[0], 1e-4),
        ("error_rotation", clean[1], value[1], SQUARE_DEGREE),
    ):
        growth = after - before
        parts = ((0.94 * growth, 0.0121 * after), (0.05 * growth, after), (0.01 * growth, after))
        rows.append(row_of(table, name, before, after, parts, unit, unsure))
    rows[0] = rows[0].assign(quantile_95=0.33)
    rows[1] = rows[1].assign(quantile_95=np.deg2rad(4.1))
    for name, part in (("translation_x", 10.0), ("translation_y", 80.0), ("translation_z", -20.0)):
        rows.append(row_of(table, name, 1.0, 90.0, ((part, 1.0), (1.0, 1.0), (1.0, 1.0)), 1e-4))
    return pd.concat(rows, ignore_index=True).assign(**changes)


def test_the_error_is_told_before_and_after_with_the_cause_that_makes_it():
    assert pose_error.sentence(of_errors(), STUDY) == (
        "pose error (root mean square): clean 0.7 cm, 0.06 deg; with all causes 18 cm, 2.5 deg "
        "(95 % of the runs within 33 cm, 4.1 deg); sensor noise makes 94 % of the growth in "
        "translation, mostly along y, and 94 % of the growth in rotation; without it 2 cm, 0.28 deg"
    )


def test_finding_begins_with_the_error_and_then_tells_nats(grid):
    text = captions.finding(grid, of_errors(), STUDY)
    error = pose_error.sentence(of_errors(), STUDY)
    assert text.startswith(f"an_experiment (Apartment 6–7): {error}. As for f: ")


def test_of_several_pairs_medians_are_told():
    table = pd.concat(
        [of_errors(value=(100.0 * k**2, k**2), source=k) for k in (1, 2, 5)], ignore_index=True
    )
    text = pose_error.sentence(table, STUDY)
    assert text.startswith("pose error (root mean square, medians over 3 pairs): clean 0.7 cm")
    assert "with all causes 20 cm, 2 deg (" in text and "; without it 2.2 cm, 0.22 deg" in text


def test_instances_in_which_a_cause_is_off_do_not_have_all_on():
    off = of_errors(value=(1.0, 1.0), instance=1).assign(sensor_noise=0.0)
    alone, both = (
        pose_error.sentence(table, STUDY) for table in (of_errors(), pd.concat([of_errors(), off]))
    )
    assert alone == both


def test_a_shrinking_error_has_its_sign_first():
    table = of_errors(clean=(306.25, 1.0), value=(27.04, 4.0))
    text = pose_error.sentence(table, STUDY)
    assert text.startswith(
        "pose error (root mean square) shrinks in translation: clean 18 cm, 1 deg; with all "
        "causes 5.2 cm, 2 deg"
    )
    assert "sensor noise lowers it most in translation, and makes 94 % of the growth in rot" in text


def test_where_the_growth_is_unsure_no_cause_is_named():
    text = pose_error.sentence(of_errors(unsure=True), STUDY)
    assert text.endswith("; the growth in translation and rotation cannot be told from zero")
    assert "sensor noise" not in text and "shrinks" not in text


@pytest.mark.parametrize("on", [0.201**2, 0.21**2, 0.19**2])
def test_what_hardly_changes_is_not_shared_out(on):
    text = pose_error.sentence(of_errors(clean=(0.49, 0.2**2), value=(316.84, on)), STUDY)
    assert "sensor noise makes 94 % of the growth in translation, mostly along y; without" in text
    assert text.endswith("; hardly any change in rotation (less than a tenth)")
    assert "growth in rotation" not in text and "shrinks" not in text
    text = pose_error.sentence(of_errors(clean=(1.44, 0.2**2), value=(1.5, on), unsure=True), STUDY)
    assert text.endswith("; hardly any change in translation and rotation (less than a tenth)")
    assert "sensor noise" not in text and "told from zero" not in text


def test_parts_are_told_where_per_cent_may_not_be():
    text = pose_error.sentence(of_errors(in_per_cent=False), STUDY)
    assert "sensor noise makes 297 of the 316 cm² that the squared error grows by in tr" in text
    assert "and 5.9 of the 6.2 deg² that the squared error grows by in rotation" in text


def test_two_causes_are_named_where_they_differ():
    table = of_errors()
    turned = table.direction == "error_rotation"
    for what in ("phi", "share", "remaining"):
        one, other = (table[f"{what}_{cause}"].copy() for cause in CAUSES[:2])
        table[f"{what}_sensor_noise"] = one.where(~turned, other)
        table[f"{what}_initial_pose"] = other.where(~turned, one)
    assert pose_error.sentence(table, STUDY).endswith(
        "sensor noise makes 94 % of the growth in translation, mostly along y; without it 2 cm, "
        "2.5 deg; initial pose scale makes 94 % of the growth in rotation; without it 18 cm, "
        "0.28 deg"
    )


def test_covariances_have_no_error_but_a_deviation():
    table = of_errors()
    names = {"error_translation": "translation", "error_rotation": "rotation"}
    table = table.assign(direction=table.direction.replace(names), quantile_95=np.nan)
    text = pose_error.sentence(table, study_of(THREE, kind="closed_form"))
    assert text.startswith(
        "no pose samples and so no error, but the standard deviation of the covariance: clean 0.7 "
        "cm, 0.06 deg; with all causes 18 cm, 2.5 deg; sensor noise makes 94 % of the growth"
    )
    assert "runs" not in text and "root mean square" not in text


def test_the_only_cause_has_nothing_without_it():
    table = of_errors()
    off = table.assign(initial_pose=1.0, partial_overlap=0.0)
    assert "without it" not in pose_error.sentence(off, STUDY)


@pytest.mark.parametrize(
    "table", [tables.empty("directions", THREE), of_errors(value=(np.nan,) * 2)]
)
def test_nothing_is_told_where_nothing_is_known(table):
    table = table[~table.direction.str.startswith("translation")]
    assert pose_error.sentence(table, STUDY) == ""
    assert pose_error.before_and_after(table, STUDY) == ("", False)


def test_the_error_in_short():
    said = pose_error.before_and_after(of_errors(), STUDY)
    assert said == ("0.7 cm, 0.06 deg to 18 cm, 2.5 deg", True)
