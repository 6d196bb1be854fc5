"""Several estimators side by side: a row each in figure, table and caption."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from known_results import (
    FIXED,
    OF_NUMBER,
    PAIRS,
    SEVEN,
    directions_table,
    fit_table,
    fixed_of,
    of_covariances,
    shap_table,
    study_of,
    without_value,
)
from matplotlib.collections import LineCollection

from icpshap import estimators as kinds
from icpshap.estimators.closed_form import ClosedForm
from icpshap.estimators.kind import Kind
from icpshap.jobs import provenance as record
from icpshap.options import values
from icpshap.presets import Preset
from icpshap.report import by_estimator, page
from icpshap.report.figures import estimators as figure_of
from icpshap.report.figures import style
from icpshap.report.study import pairs_of

OPTIONS = {
    "paper": {"kind": "monte_carlo"},
    "robust": {
        "kind": "monte_carlo",
        "noise_draws": 10,
        "bias_correction": "jackknife",
        "wrong_basins": "leave_out",
    },
    "told": {"kind": "closed_form", "noise_draws": 5},
    "brossard": {"kind": "unscented", "noise": "fixed", "sensor_sigma": 0.05, "bias": True},
    "blind": {"kind": "fitness"},
}


@pytest.fixture(autouse=True)
def shipped_kinds(registries, monkeypatch):
    """The kinds that are shipped, in the place of that of the same name in other tests."""
    monkeypatch.setitem(kinds.KINDS, "closed_form", ClosedForm)


def part(name, shap, **options):
    """What an estimator of these options made of a shap table."""
    preset = Preset.of(**options)
    causes = [c for c in SEVEN if c in shap]
    study = study_of(
        causes,
        name=f"several_{name}",
        estimator=name,
        kind=options["kind"],
        options=values(preset.estimator.kind),
        noise_draws=options.get("noise_draws", 1),
        bias_correction=options.get("bias_correction", "none"),
        wrong_basins=options.get("wrong_basins", "keep"),
    )
    if options["kind"] != "monte_carlo":
        shap = of_covariances(shap, options.get("noise_draws", 1))
    if name == "blind":
        numbers = [c for c in shap if c == "f" or c.startswith("phi_")]
        shap[[c for c in numbers if shap[c].dtype == float and not c.endswith(("w", "h"))]] = 0.0
    settings = shap[["sequence", "reference", "source", *causes]]
    settings = pd.concat([settings.assign(again=False), settings.assign(again=True)])
    settings["success_rate"] = np.where(settings.again, 0.5, 0.97)
    return by_estimator.Part(study, shap, settings)


def joined(shap=None, names=tuple(OPTIONS)):
    """The table of some estimators, and the study that they share."""
    shap = shap_table(FIXED) if shap is None else shap
    parts = [part(name, shap.copy(), **OPTIONS[name]) for name in names]
    return by_estimator.joined(parts), replace(parts[0].study, name="several")


def panels(figure):
    """Axes by what their label names."""
    return {axes.get_xlabel().replace("\n", " "): axes for axes in figure.axes if axes.axison}


def marks(axes):
    """(x, y, marker, face) of every number that is drawn."""
    return [
        (x, y, line.get_marker(), line.get_markerfacecolor())
        for line in axes.lines
        if line.get_marker() in ("o", "D", "|")
        for x, y in zip(line.get_xdata(), line.get_ydata(), strict=True)
    ]


def intervals(axes):
    """Ends of the intervals by row."""
    found = {}
    for collection in axes.collections:
        if isinstance(collection, LineCollection):
            for (low, y), (high, _) in collection.get_segments():
                found[round(y)] = (low, high)
    return found


# --- the table ------------------------------------------------------------------------------------


def test_a_row_for_each_estimator_with_its_own_numbers():
    shap = shap_table(FIXED)
    table, _ = joined(shap)
    assert list(table.estimator) == list(OPTIONS)
    told = table.set_index("estimator").loc["told"]
    assert told.phi_sensor_noise == shap.phi_sensor_noise.item()
    assert (told.n_runs, told.interval_over, told.kind) == (5, "noise draws", "closed_form")
    success = table.set_index("estimator").success_rate
    assert success["paper"] == 0.97  # that of the instance, not of the clean settings
    assert np.isnan(success["told"])  # it starts at the truth
    assert table.set_index("estimator").loc["brossard"].no_interval.startswith("the estimator is d")


ADDED = {"sensor_sigma": 0.01, "sensor_noise_by": "closed_form"}


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"kind": "closed_form"}, "1 cm and σ"),
        ({"kind": "unscented", "noise": "fixed", "sensor_sigma": 0.05}, "5 cm always"),
        ({"kind": "closed_form", "noise": "residuals"}, "its residuals"),
        ({"kind": "gicp"}, ""),
        ({"kind": "monte_carlo"}, ""),
        ({"kind": "monte_carlo", "sensor_sigma": 0.01, "noise_draws": 10}, "1 cm, drawn"),
        ({"kind": "monte_carlo", **ADDED}, "1 cm and σ"),
        ({"kind": "monte_carlo", **ADDED, "noise_draws": 5}, "1 cm"),
    ],
)
def test_what_an_estimator_was_told(options, expected):
    of = Preset.of(**options).estimator
    assert by_estimator.told(values(of.kind), of.returned) == expected
    assert by_estimator.told({"sensor_sigma": 0.018}, of.returned) == "1.8 cm"


@pytest.mark.parametrize("kind", list(kinds.KINDS))
def test_every_kind_says_what_its_covariance_is_made_of(kind):
    needed = {"register": "icpshap.registrations:small_gicp"} if kind == "callable" else {}
    assert kinds.KINDS[kind](**needed).made_of

    class Both(Kind):
        returns = kinds.kind.Returns(samples=True, covariances=True)

    assert Both().made_of == "scatter of the samples and covariances of its own"


def test_the_file_holds_the_table(tmp_path):
    table, _ = joined()
    table.to_csv(tmp_path / "table.csv", index=False)
    found = by_estimator.read(tmp_path / "table.csv")
    pd.testing.assert_frame_equal(found, table, check_dtype=False)


def test_markdown_has_values_intervals_and_why_there_are_none():
    table, study = joined()
    lines = by_estimator.markdown(table, study).splitlines()
    row = {line.split("|")[1].strip(): line for line in lines[2 : 2 + len(OPTIONS)]}
    paper = table.iloc[0]
    value = f"{paper.f:.2f} [{paper.f_low:.2f}, {paper.f_high:.2f}]"
    assert value in row["paper"] and "over runs" in row["paper"] and "0 of 100" in row["paper"]
    assert "| 1 cm and σ" in row["told"] and "over noise draws" in row["told"]
    assert "none: the estimator is deterministic" in row["brossard"] and "[" not in row["brossard"]
    assert "97 %" in row["paper"] and "%" not in row["told"] and "nan" not in "".join(lines)


def test_of_several_pairs_the_table_has_medians():
    table, study = joined(shap_table(FIXED, PAIRS))
    text = by_estimator.markdown(table, study)
    rows = table[table.estimator == "paper"]
    assert f"{rows.f.median():.2f}" in text and "Numbers are medians." in text
    assert "95 % intervals" not in text


def test_latex_has_no_letter_of_its_own():
    table, study = joined()
    text = by_estimator.latex(table, study).split("\n", 1)[1]
    assert not set(text) & set("φσ°") and r"95 \% intervals" in text
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert len(rows) == len(OPTIONS) + 1 and len({line.count("&") for line in rows}) == 1


# --- the figure -----------------------------------------------------------------------------------


@pytest.mark.parametrize("number", OF_NUMBER)
def test_a_panel_for_each_cause_and_a_row_for_each_estimator(number):
    table, study = joined(fixed_of(OF_NUMBER[number], PAIRS[:1]))
    found = panels(figure_of.picture(table, study))
    assert len(found) == number + 1
    for cause in study.players:
        axes = found[f"φ {cause.title} [nats]"]
        drawn = sorted(marks(axes), key=lambda mark: mark[1])
        assert [mark[1] for mark in drawn] == list(range(len(OPTIONS)))
        assert [mark[0] for mark in drawn] == list(table[f"phi_{cause.name}"])
    assert sorted(mark[0] for mark in marks(found["f [nats]"])) == sorted(table.f)


def test_intervals_are_those_of_the_table_and_missing_where_there_are_none():
    table, study = joined()
    axes = panels(figure_of.picture(table, study))["φ sensor noise [nats]"]
    found = intervals(axes)
    for y, row in enumerate(table.itertuples()):
        if row.interval_over:
            assert found[y] == (row.phi_sensor_noise_low, row.phi_sensor_noise_high)
        else:
            assert y not in found
    markers = {y: marker for _, y, marker, _ in marks(axes)}
    assert [markers[y] == "D" for y in range(len(table))] == list(table.interval_over == "")


def test_what_cannot_be_told_from_zero_is_open():
    shap = shap_table(FIXED)
    shap["phi_initial_pose"], shap["phi_initial_pose_low"] = 0.1, -0.1
    shap["phi_initial_pose_high"] = 0.3
    table, study = joined(shap, ["paper"])
    (mark,) = marks(panels(figure_of.picture(table, study))["φ initial pose scale [nats]"])
    assert mark[2:] == ("o", "white")


def test_of_several_pairs_dots_and_their_median():
    table, study = joined(shap_table(FIXED, PAIRS), ["paper", "told"])
    axes = panels(figure_of.picture(table, study))["φ sensor noise [nats]"]
    values = table[table.estimator == "told"].phi_sensor_noise
    found = [mark for mark in marks(axes) if mark[1] == 1]
    assert sorted(m[0] for m in found if m[2] == "o") == sorted(values)
    assert [m[0] for m in found if m[2] == "|"] == [values.median()]
    assert not intervals(axes)


def test_rows_are_named_with_what_they_were_told_and_do_not_collide():
    names = {f"an_estimator_{k}": OPTIONS["told"] for k in range(14)}
    parts = [part(name, shap_table(FIXED), **options) for name, options in names.items()]
    table, study = by_estimator.joined(parts), replace(parts[0].study, name="several")
    figure = figure_of.picture(table, study)
    figure.canvas.draw()
    labels = figure.axes[0].get_yticklabels()
    assert labels[0].get_text() == "an_estimator_0\ntold 1 cm and σ"
    boxes = [label.get_window_extent() for label in labels]
    for above, below in pairwise(boxes):
        assert above.y0 > below.y1
    for axes in figure.axes:
        ticks = [t for t in axes.get_xticklabels() if t.get_text() and t.get_visible()]
        left, right = axes.get_xlim()
        inside = [t.get_window_extent() for t in ticks if left <= t.get_position()[0] <= right]
        assert all(a.x1 < b.x0 for a, b in pairwise(inside))


def test_an_estimator_without_a_value_keeps_its_row():
    parts = [part(name, shap_table(FIXED), **OPTIONS[name]) for name in ("paper", "told")]
    lost = without_value(parts[1].shap, [0], "").assign(warning="only 2 noise draws left")
    table = by_estimator.joined([parts[0], parts[1]._replace(shap=lost)])
    study = parts[0].study
    axes = panels(figure_of.picture(table, study))["φ sensor noise [nats]"]
    assert [mark[1] for mark in marks(axes)] == [0]
    assert [line.get_ydata()[0] for line in axes.lines if line.get_marker() == "x"] == [1]
    assert "No value: only 2 noise draws left (told)." in by_estimator.caption(table, study)
    assert "| no value" in by_estimator.markdown(table, study)
    nothing = by_estimator.joined([parts[1]._replace(shap=lost)])
    assert "No estimator has a value." in figure_of.picture(nothing, study).axes[0].texts[0]._text
    assert "no estimator has a value" in by_estimator.finding(nothing, study)


# --- words ----------------------------------------------------------------------------------------


def test_caption_says_what_each_was_told_made_of_and_why_it_has_no_interval():
    table, study = joined()
    text = by_estimator.caption(table, study)
    for said in (
        "Shapley values of the causes and f, a row for each estimator, Apartment 6–7 at "
        "sensor noise σ = 0.05 m",
        "told: 1 cm and σ (told); 5 cm always (brossard); the others none.",
        "over runs (paper and robust); noise draws (told)",
        "nothing varies (brossard and blind).",
        "fitness score, as in hdl_graph_slam (blind)",
        "by jackknife (robust)",
        "in a wrong basin were left out by robust.",
    ):
        assert said in text
    assert "Diamonds" not in by_estimator.caption(*joined(names=["paper", "told"]))
    assert "were told" not in by_estimator.caption(*joined(names=["paper"]))


def test_finding_names_the_largest_cause_and_the_blind():
    table, study = joined()
    text = by_estimator.finding(table, study)
    assert text.startswith("several (Apartment 6–7): the largest φ is that of ")
    assert "of 4 estimators" in text and "f is below 0.01 nats for blind." in text


def test_the_pose_error_of_each_estimator_is_told_first():
    errors = [
        ("paper", "0.7 cm, 0.06 deg to 18 cm, 2.5 deg", True),
        ("told", "1 cm, 1 deg to 2 cm, 2 deg", False),
        ("blind", "", False),
    ]
    assert by_estimator.finding(*joined(), errors).startswith(
        "several (Apartment 6–7): pose error (root mean square) clean to all causes 0.7 cm, 0.06 "
        "deg to 18 cm, 2.5 deg (paper); standard deviation of covariances, where no samples tell "
        "the error, clean to all causes 1 cm, 1 deg to 2 cm, 2 deg (told): the largest φ is that of"
    )


def test_what_breaks_the_answers_of_some_comes_first():
    table, study = joined()
    names = list(table.estimator.unique())
    table = table.assign(misfit=np.where(table.estimator == names[0], "Rings: voxels.", ""))
    said = (
        f"Settings do not fit the scans, which breaks these answers. Rings: voxels. ({names[0]})."
    )
    assert by_estimator.caption(table, study).startswith(said)
    assert by_estimator.note(table, study).startswith(said)
    assert by_estimator.finding(table, study).startswith(
        f"several (Apartment 6–7): {said} As they are: the largest φ"
    )


def test_page_and_summary_tell_them_together(tmp_path):
    table, study = joined(names=("paper", "told"))
    parts = [part(name, shap_table(FIXED), **OPTIONS[name]) for name in ("paper", "told")]
    sections = [
        page.Section(
            found.study.name,
            found.study,
            found.shap,
            directions_table(),
            pairs_of(found.shap).assign(warning=""),
            fit_table(found.shap),
            None,
            None,
            [],
            [],
        )
        for found in parts
    ]
    sections.append(replace(sections[0], scope="alone", study=replace(study, name="alone")))
    figure = tmp_path / "by_estimator.svg"
    style.save(figure_of.picture(table, study), figure)
    figure.with_suffix(".txt").write_text(by_estimator.caption(table, study))
    names = [found.study.name for found in parts]
    together = [page.Estimators("several", study, table, names, figure, [])]
    run = record.provenance({"run": []}, {}, tmp_path, tmp_path)
    text = page.page(sections, run, tmp_path, joined=together)
    top = text[: text.index('id="warnings"')]
    assert "clean to all causes" in top and "(paper); " in top  # the errors of its estimators
    assert top.count('class="finding"') == 2  # of all estimators together, and of the other one
    assert 'id="several-by_estimator"' in text and "<td>told</td>" in text.replace(" ", "")
    assert all(f'id="{name}"' in text for name in names)
    summary = page.summary(sections, "results/report.html", together)
    assert "results/several/ (figures/by_estimator.png, tables/by_estimator.md)" in summary
    assert "results/several_paper/" not in summary and "results/alone/" in summary
    assert by_estimator.finding(table, study).split(": ", 1)[1] in summary
