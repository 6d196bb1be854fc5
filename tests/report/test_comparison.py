"""Ours against the paper, where there is something to compare."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from known_results import (
    FIXED,
    PRINTED,
    SEVEN,
    STUDY,
    THREE,
    WATERFALL,
    fixed_of,
    grid_of,
    of_covariances,
    ranking,
    ranking_row,
    shap_table,
    study_of,
)

from icpshap.report import comparison, tables

PAPER = pd.DataFrame(
    [
        ("waterfall", 0.1, 1.5, 0.05, "phi_sensor_noise", 39.61, 39.61),
        ("summary", np.nan, np.nan, np.nan, "phi_initial_pose", -1.2, 22.2),
    ],
    columns=["figure", *THREE, "quantity", "low", "high"],
)


def test_comparison_takes_values_from_where_the_paper_has_them():
    table = shap_table()
    rows = comparison.compare_figures(table, PAPER, STUDY).set_index("shown_in")
    shown = STUDY.instance(table, WATERFALL).iloc[0]
    assert rows.loc["waterfall plot", "value"] == shown.phi_sensor_noise
    assert rows.loc["waterfall plot", "low"] == shown.phi_sensor_noise_low
    noisy = table[table.sensor_noise > 0].phi_initial_pose
    assert rows.loc["summary plot", ["low", "high"]].tolist() == [noisy.min(), noisy.max()]
    other_pair = comparison.compare_figures(shap_table(pairs=[("eth", 6, 7)]), PAPER, STUDY)
    assert len(other_pair) == 0


def test_comparison_of_medians_uses_the_default_rule_and_known_values():
    rows = [ranking_row("apartment", rule, **PRINTED) for rule in tables.RULES]
    table = comparison.compare_medians(ranking(*rows), STUDY)
    assert table[["quantity", "value", "paper_low"]].to_numpy().tolist() == [
        ["sensor_noise", 8.0, 7.9]
    ]
    assert "1 of 1 single values of the paper lie in our intervals." in comparison.caption(table)


def test_only_the_papers_perturbation_and_divergence_are_compared():
    assert comparison.is_comparable(shap_table(FIXED), STUDY)
    assert not comparison.is_comparable(shap_table(FIXED | {"sensor_noise": (0.1,)}), STUDY)
    assert not comparison.is_comparable(shap_table(FIXED), replace(STUDY, divergence="reverse_kl"))
    assert not comparison.is_comparable(shap_table(), STUDY)
    scanners_own = replace(STUDY, variants={"sensor": "hokuyo_utm_30lx"})
    assert not comparison.is_comparable(shap_table(FIXED), scanners_own)


def test_comparison_figure_has_every_estimator_and_the_paper():
    parts = [
        comparison.compare_medians(
            ranking(ranking_row("apartment", **PRINTED)), replace(STUDY, estimator=estimator)
        )
        for estimator in ("paper", "robust")
    ]
    figure = comparison.draw(pd.concat(parts), STUDY.titles)
    lines = {line.get_label(): line for line in figure.axes[0].lines}
    assert lines["ours, estimator robust"].get_xdata() == pytest.approx([8.0])
    assert lines["the paper"].get_xdata() == pytest.approx([7.9, 7.9])
    assert [axes.get_xlabel()[-6:] for axes in figure.axes] == ["[nats]"] * 3


def test_other_causes_are_not_compared():
    for names in (THREE[:2], SEVEN[:5]):
        assert not comparison.is_comparable(fixed_of(names), study_of(names))
        assert len(comparison.compare_figures(grid_of(names), PAPER, study_of(names))) == 0
    other = replace(STUDY, divergence="translation_rmse")
    assert len(comparison.compare_figures(shap_table(), PAPER, other)) == 0


def test_any_estimator_is_compared_and_may_have_no_interval():
    study = replace(STUDY, kind="closed_form", estimator="closed")
    assert comparison.is_comparable(of_covariances(shap_table(FIXED)), study)
    table = comparison.compare_figures(of_covariances(shap_table()), PAPER, study)
    text = comparison.markdown(table, STUDY.titles)
    assert "nan" not in text and "sensor noise" in text
    assert "0 of 0 single values" in comparison.caption(table)
    comparison.draw(table, STUDY.titles).canvas.draw()


def test_nothing_to_compare_is_said():
    nothing = comparison.compare_figures(grid_of(SEVEN[:5]), PAPER, study_of(SEVEN[:5]))
    assert comparison.caption(nothing) == comparison.NOTHING
    figure = comparison.draw(nothing, {})
    assert figure.axes[0].texts[0].get_text() == comparison.NOTHING
