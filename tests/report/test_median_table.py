"""The medians of each sequence, beside the paper's, as Markdown and as LaTeX."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from known_results import (
    OF_NUMBER,
    PRINTED,
    STUDY,
    THREE,
    ranking,
    ranking_row,
    study_of,
)

from icpshap.explanation.ranking import ranking_table
from icpshap.report import comparison, tables


def test_median_table_marks_what_cannot_be_told_from_zero():
    text = tables.markdown(ranking(ranking_row("apartment")), STUDY)
    assert re.search(r"8\.00 \[7\.50, 8\.50\] +\| 0\.10 \[-0\.40, 0\.60\]° +\|", text)
    assert "| Apartment  | 4 of 5" in text
    assert "0.98 (p = 0.02)" in text
    assert "P(sensor noise > partial overlap > initial pose scale)" in text


def test_median_table_sets_the_papers_value_beside_ours():
    row = ranking_row("apartment", **PRINTED)
    text = tables.markdown(ranking(row, ranking_row("eth")), STUDY)
    assert re.search(r"8\.00 \[7\.50, 8\.50\] +\| 7\.90 +\|", text)
    assert "1 of the paper's 1 values lie in our intervals." in text
    without = tables.markdown(ranking(ranking_row("eth")), STUDY)
    assert "paper" not in without.replace("estimator paper", "")


def test_latex_table_compiles_in_its_parts():
    text = tables.latex(ranking(ranking_row("apartment")), STUDY)
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 1
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {line.count("&") for line in rows} == {5}
    assert r"0.10 [-0.40, 0.60]$^\circ$" in text
    assert "°" not in text and " > " not in text.split("\n", 1)[1]


def test_titles_cannot_break_a_table():
    """LaTeX and Markdown give letters a meaning of their own."""
    title = r"a_b & 50 % #1 {x} $y$ ~ ^ \z|w"
    study = replace(STUDY, titles={"apartment": title})
    text = tables.latex(ranking(ranking_row("apartment")), study)
    assert (
        r"a\_b \& 50 \% \#1 \{x\} \$y\$ \textasciitilde{} \textasciicircum{} "
        r"\textbackslash{}z|w" in text
    )
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {line.replace(r"\&", "").count("&") for line in rows} == {5}
    assert r"\z\|w" in tables.markdown(ranking(ranking_row("apartment")), study)
    page = tables.html(
        ranking(ranking_row("apartment")), replace(STUDY, titles={"apartment": "<script>"})
    )
    assert "<script>" not in page and "&lt;script&gt;" in page


def test_median_table_of_a_sequence_without_values():
    nothing = {f"median_{name}{end}": np.nan for name in THREE for end in ("", "_low", "_high")}
    row = ranking_row("eth", probability=np.nan, p_holm=np.nan, n_rows=0, n_removed=0, **nothing)
    text = tables.markdown(ranking(row), STUDY)
    assert "| no value" in text
    assert "nan" not in text


def test_every_reading_of_the_outlier_rule_is_listed():
    rows = [ranking_row("apartment", rule) for rule in tables.RULES]
    text = tables.markdown(ranking(*rows), STUDY)
    for rule in tables.RULES.values():
        assert f"| {rule} " in text


@pytest.mark.parametrize("number", OF_NUMBER)
def test_median_table_has_a_column_for_each_cause(number):
    names = OF_NUMBER[number]
    text = tables.markdown(ranking(ranking_row("eth", causes=names)), study_of(names))
    header = text.splitlines()[0]
    for cause in study_of(names).players:
        assert f"| {cause.title} [nats]" in header
    assert tables.latex(ranking(ranking_row("eth", causes=names)), study_of(names))


@pytest.mark.parametrize(
    "names, expected",
    [
        (THREE, "P(sensor noise > partial overlap > initial pose scale)"),
        (("initial_pose", "partial_overlap", "motion"), "P(partial overlap > initial pose scale)"),
        (("sensor_noise", "motion"), None),
        (("sensor_noise",), None),
    ],
)
def test_the_order_is_that_of_the_papers_causes_which_are_there(names, expected, tmp_path):
    generator = np.random.default_rng(0)
    phi = pd.DataFrame(
        generator.normal(1, 0.1, (8, len(names))), columns=[f"phi_{n}" for n in names]
    )
    shap = phi.assign(sequence="eth", reference=range(8), source=range(1, 9), instance=0)
    resampled = pd.concat([shap.assign(resample=k) for k in range(3)])
    table = ranking_table(shap, resampled, names, order=comparison.PAPER_ORDER)
    table.to_csv(tmp_path / "ranking.csv", index=False)
    for kept in (
        table,
        pd.read_csv(tmp_path / "ranking.csv", keep_default_na=False, na_values=[""]),
    ):
        text = tables.markdown(kept, study_of(names))
        assert (f"| {expected}" if expected else "P(") in text or not expected
        assert ("P(" in text) == ("P is the share" in text) == bool(expected)
        assert "nan" not in text


def test_what_is_resampled_is_what_varies():
    rows = ranking(ranking_row("eth"))
    for kind, draws, expected in (
        ("monte_carlo", 1, "over pairs and runs."),
        ("closed_form", 1, "over pairs."),
        ("closed_form", 5, "over pairs and noise draws."),
        ("particles", 5, "over pairs and noise draws."),
    ):
        assert expected in tables.note(rows, study_of(THREE, kind=kind, noise_draws=draws))


def test_the_note_does_not_count_the_causes():
    assert "A pair goes if any of its values lies" in tables.note(
        ranking(ranking_row("eth")), STUDY
    )
