"""What the explained instance becomes with other options, and what to do."""

import numpy as np
import pandas as pd
import pytest
from known_results import (
    FIXED,
    PAIRS,
    STUDY,
    directions_table,
    fit_table,
    shap_table,
    without_value,
)

from icpshap.fit import checks
from icpshap.report import advice, captions, fit, what_if

CHANGES = {
    what_if.AS_IT_IS: {},
    "more_points": {"subsampling_probability": 0.2, "maximum_distance": None},
    "tight_stop": {"stop_translation": 1e-5},
}


def joined(pairs=PAIRS[:1], **errors):
    """The table; errors [m] of the perturbed runs by name of the change."""
    parts = []
    for name, changes in CHANGES.items():
        shap = shap_table(FIXED, pairs).assign(
            translation_rmse=errors.get(name, 0.178), rotation_rmse=np.deg2rad(2.5)
        )
        parts.append((name, changes, shap))
    of_pairs = shap_table(FIXED, pairs).assign(characteristic_length=0.01)
    return what_if.table(parts, of_pairs)


def test_a_row_a_change_and_pair_with_the_change_as_one_writes_it():
    table = joined(PAIRS)
    assert len(table) == len(CHANGES) * len(PAIRS)
    assert list(table.changes.unique()) == [
        "",
        "subsampling_probability: 0.2, maximum_distance: null",
        "stop_translation: 1e-05",
    ]


def test_the_best_is_named_with_its_effect():
    said = what_if.advice(joined(more_points=0.08, tight_stop=0.1), STUDY)
    assert said.startswith(
        "Of what was tried, more points (subsampling_probability: 0.2, maximum_distance: null) "
        "helps most: the error with all causes falls from 18 cm, 2.5 deg to 8 cm, 2.5 deg, f "
    )


def test_where_nothing_helps_the_data_must_change():
    said = what_if.advice(joined(more_points=0.17), STUDY)
    assert said == (
        "Nothing that was tried (more points and tight stop) lowers the error with all causes by a "
        "tenth: the data must change, not the options."
    )


def test_of_several_pairs_medians_are_told():
    table = joined(PAIRS, more_points=[0.3, 0.05, 0.06])
    assert what_if.medians(table).translation_rmse[1] == pytest.approx(0.06)
    assert "in the median over pairs" in what_if.advice(table, STUDY)
    assert "to 6 cm" in what_if.advice(table, STUDY)


def test_without_samples_there_is_no_error_to_lower():
    table = joined(more_points=np.nan, tight_stop=np.nan, **{what_if.AS_IT_IS: np.nan})
    assert what_if.advice(table, STUDY).startswith("What was tried returns no pose samples")
    assert "no samples" in what_if.markdown(table, STUDY)


def test_the_table_is_read_as_it_was_written(tmp_path):
    table = joined(more_points=0.08)
    table.to_csv(tmp_path / "what_if.csv", index=False)
    text = what_if.html(what_if.read(tmp_path / "what_if.csv"), STUDY)
    assert text == what_if.html(table, STUDY)
    assert "as it is" in text and "8 cm, 2.5 deg" in text


class TestAdvice:
    def test_what_was_not_tried_is_said_to_be(self):
        shap = shap_table(FIXED, PAIRS[:1])
        shap = shap.assign(
            removal_sensor_noise=5.0, removal_sensor_noise_low=4.0, removal_sensor_noise_high=6.0
        )
        fit = fit_table(shap, source_points=250.0, overlap=0.2)
        said = advice.sentences(shap, fit, None, STUDY)
        assert said[0] == "What may mend points (not tried): subsampling_probability: 0.3."
        assert said[1] == (
            "What may mend overlap (not tried): scans that are nearer to each other."
        )
        assert said[2] == (
            "f falls most without sensor noise. What may lower it (not tried): a more exact "
            "scanner, or points averaged on a grid."
        )
        narrow = shap.assign(narrows_sensor_noise=True)  # less noise makes no error smaller
        assert not any(
            "sensor noise" in text for text in advice.sentences(narrow, fit, None, STUDY)
        )

    def test_what_was_tried_comes_first(self):
        shap = shap_table(FIXED, PAIRS[:1])
        said = advice.sentences(shap, fit_table(shap), joined(more_points=0.08), STUDY)
        assert said[0].startswith("Of what was tried, more points")

    def test_without_values_there_is_nothing_to_remove(self):
        shap = without_value(shap_table(FIXED, PAIRS[:1]), [0], "no overlap")
        assert advice.sentences(shap, fit_table(shap), None, STUDY) == []


BROKEN = "93% of the neighbourhoods lie on one ring: voxel_size: 0.25."
SAID = f"The settings do not fit the scans, which breaks this answer. {BROKEN}"


@pytest.mark.parametrize("figure", ["summary", "waterfall", "interactions"])
def test_what_breaks_an_answer_comes_first_in_every_caption(figure):
    shap = shap_table(FIXED, PAIRS[:1]).assign(misfit=BROKEN)
    caption = captions.caption(figure, shap, STUDY)
    assert caption.startswith(SAID) and caption.count(BROKEN) == 1
    assert SAID not in captions.caption(figure, shap.assign(misfit=""), STUDY)


def test_what_breaks_an_answer_comes_first_in_the_finding_and_over_tables():
    shap = shap_table(FIXED, PAIRS[:1]).assign(misfit=BROKEN)
    found = captions.finding(shap, directions_table(), STUDY)
    assert found.startswith(f"an_experiment (Apartment 0–1): {SAID} As it is: pose error")
    assert fit.first("a table", fit.misfits(shap, STUDY)) == f"{SAID}\n\na table"
    assert fit.first("a table", "") == "a table"


def test_of_several_pairs_those_are_named_that_it_breaks():
    shap = shap_table(FIXED, PAIRS).assign(misfit=["", BROKEN, BROKEN])
    assert f"Apartment 1–2, ETH 0–1: {BROKEN}" in fit.misfits(shap, STUDY)

    def test_a_remedy_of_its_own_stands_before_that_of_the_other_checks(self):
        shap = shap_table(FIXED, PAIRS[:1])
        fit = fit_table(shap, source_points=250.0)
        late = fit.head(1).assign(check="clean success", grade="red", remedy=checks.AS_ABOVE)
        said = advice.sentences(shap, pd.concat([late, fit]), None, STUDY)
        assert said[0] == "What may mend points (not tried): subsampling_probability: 0.3."
        assert not any(checks.AS_ABOVE in text for text in said)
        said = advice.sentences(shap, late, None, STUDY)
        assert said[0] == f"What may mend clean success (not tried): {checks.AS_ABOVE}."
