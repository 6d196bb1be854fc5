"""Figures show what the tables hold, say what they are, and come out the same each time."""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from known_results import (
    LEVELS,
    OF_NUMBER,
    SEVEN,
    STUDY,
    THREE,
    WATERFALL,
    fixed_of,
    grid_of,
    of_covariances,
    shap_table,
    study_of,
    without_value,
)
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.patches import FancyArrow

from icpshap.report import figures
from icpshap.report.figures import style
from icpshap.report.study import contains_zero

DEPENDENCE = tuple(STUDY.dependence_figures)
GRID_FIGURES = ("summary", "waterfall", "interactions", *DEPENDENCE)
FIXED_FIGURES = ("summary", "interactions", "pairs")


def dots_of(collection):
    return np.asarray(collection.get_offsets())


def dots(axes):
    """Positions of all dots that a scatter drew."""
    parts = [c for c in axes.collections if isinstance(c, PathCollection)]
    return np.concatenate([dots_of(part) for part in parts])


def drawn(name, table, study=STUDY):
    figure, caption = figures.draw(name, table, None, study)
    figure.canvas.draw()
    return figure, caption


# --- what is drawn is what the table holds --------------------------------------------------------


@pytest.mark.parametrize("number", OF_NUMBER)
def test_summary_has_a_dot_for_every_value_of_a_cause_that_is_on(number):
    study = study_of(OF_NUMBER[number])
    table = grid_of(study.causes)
    axes = drawn("summary", table, study)[0].axes[0]
    found = dots(axes)
    labels = [text.get_text() for text in axes.get_yticklabels()]
    assert len(labels) == number
    for row, label in enumerate(labels):
        cause = next(c for c in study.players if label.split("\n")[0] == c.label())
        x = found[np.abs(found[:, 1] - row) < 0.5, 0]
        on = table[table[cause.name] != cause.off]
        assert np.sort(x) == pytest.approx(np.sort(on[f"phi_{cause.name}"]))


def test_dots_that_lie_together_are_stacked_by_level_within_their_row(grid):
    grid["phi_sensor_noise"] = np.where(grid.sensor_noise > 0, 3.0, 0.0)
    axes = drawn("summary", grid)[0].axes[0]
    (part,) = (c for c in axes.collections if np.allclose(dots_of(c)[:, 0], 3.0))
    y = np.sort(dots_of(part)[:, 1])
    assert len(y) == (grid.sensor_noise > 0).sum() and np.ptp(y) < 0.8
    assert np.diff(y) == pytest.approx(np.full(len(y) - 1, np.diff(y)[0]))
    on = grid[grid.sensor_noise > 0].sensor_noise.to_numpy()
    assert (np.diff(on[np.argsort(dots_of(part)[:, 1])]) >= 0).all()


def test_summary_counts_what_can_be_told_from_zero(grid):
    figure, _ = drawn("summary", grid)
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    on = grid[grid.sensor_noise > 0]
    expected = f"{on.phi_sensor_noise_significant.sum()} of {len(on)} ≠ 0"
    assert f"sensor noise σ [m]\n{expected}" in labels


def test_waterfall_arrows_add_up_to_f(grid):
    row = STUDY.instance(grid, WATERFALL).iloc[0]
    figure, caption = drawn("waterfall", grid)
    axes = figure.axes[0]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrow)]
    values = sorted((row[f"phi_{name}"] for name in THREE), key=abs)
    ends = np.concatenate([[0], np.cumsum(values)])
    for arrow, start, end in zip(arrows, ends[:-1], ends[1:], strict=True):
        x = arrow.get_xy()[:, 0]
        assert (x.min(), x.max()) == pytest.approx((min(start, end), max(start, end)))
    assert ends[-1] == pytest.approx(row.f)
    assert f"f = {row.f:.2f} nats" in caption


def test_waterfall_intervals_stand_where_the_arrow_starts(grid):
    row = STUDY.instance(grid, WATERFALL).iloc[0]
    axes = drawn("waterfall", grid)[0].axes[0]
    intervals = [line.get_xdata() for line in axes.lines if line.get_linewidth() == 1.2]
    start = 0.0
    ranked = sorted(THREE, key=lambda name: abs(row[f"phi_{name}"]))
    for interval, name in zip(intervals, ranked, strict=True):
        expected = [start + row[f"phi_{name}_low"], start + row[f"phi_{name}_high"]]
        assert list(interval) == pytest.approx(expected)
        start += row[f"phi_{name}"]


def test_waterfall_hatches_what_cannot_be_told_from_zero(grid):
    grid[["phi_sensor_noise_low", "phi_sensor_noise_high"]] = -9.0, 9.0
    for name in ("initial_pose", "partial_overlap"):
        grid[[f"phi_{name}_low", f"phi_{name}_high"]] = 1.0, 9.0
    axes = drawn("waterfall", grid)[0].axes[0]
    labels = [text.get_text() for text in axes.get_yticklabels()]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrow)]
    for label, arrow in zip(labels, arrows, strict=True):
        assert (arrow.get_hatch() is not None) == label.startswith("sensor noise")


def test_noise_floor_and_a_a_value_are_drawn(grid):
    axes = drawn("waterfall", grid)[0].axes[0]
    handles, labels = axes.get_legend_handles_labels()
    marks = dict(zip(labels, handles, strict=True))
    floor = marks["noise floor: f by chance alone (95 %)"]
    again = marks["A/A value: f between two clean samples, 0.30"]
    assert floor.get_width() == pytest.approx(0.368)
    assert again.get_xdata()[0] == pytest.approx(0.3)


def test_an_a_a_value_far_above_f_does_not_squash_the_arrows(grid):
    before = drawn("waterfall", grid)[0].axes[0].get_xlim()
    axes = drawn("waterfall", grid.assign(f_again=254888.2))[0].axes[0]
    label = "A/A value: f between two clean samples, 2.55e+05 (off the axis)"
    assert label in axes.get_legend_handles_labels()[1]
    assert axes.get_xlim() == before


def test_huge_values_get_a_logarithmic_axis(grid):
    assert drawn("summary", grid)[0].axes[0].get_xscale() == "linear"
    grid.loc[17, "phi_partial_overlap"] = -400_000.0
    figure, caption = drawn("summary", grid)
    assert figure.axes[0].get_xscale() == "symlog"
    assert "The axis is linear up to 1 and logarithmic beyond." in caption
    assert drawn(DEPENDENCE[2], grid)[0].axes[0].get_yscale() == "symlog"


@pytest.mark.parametrize("name", DEPENDENCE)
def test_dependence_dots_medians_and_open_marks(grid, name):
    cause, _ = STUDY.dependence_figures[name]
    phi = grid[f"phi_{cause.name}"]
    axes = drawn(name, grid)[0].axes[0]
    closed, opened = (c for c in axes.collections if isinstance(c, PathCollection))
    significant = grid[f"phi_{cause.name}_significant"]
    assert dots_of(closed)[:, 1] == pytest.approx(phi[significant].to_numpy())
    assert dots_of(opened)[:, 1] == pytest.approx(phi[~significant].to_numpy())
    assert len(opened.get_facecolors()) == 0
    # A dot lies in the lane of its own level, which its label names.
    levels = np.array(LEVELS[cause.name])
    lanes = np.round(dots_of(closed)[:, 0]).astype(int)
    assert levels[lanes] == pytest.approx(grid[cause.name][significant].to_numpy())
    assert [text.get_text() for text in axes.get_xticklabels()] == [f"{x:g}" for x in levels]
    median = next(line for line in axes.lines if line.get_marker() == "_")
    assert median.get_ydata() == pytest.approx(phi.groupby(grid[cause.name]).median().to_numpy())


def test_dependence_colour_is_the_other_cause(grid):
    cause, other = STUDY.dependence_figures[DEPENDENCE[0]]
    axes = drawn(DEPENDENCE[0], grid)[0].axes[0]
    closed = next(c for c in axes.collections if isinstance(c, PathCollection))
    high = grid[other.name][grid[f"phi_{cause.name}_significant"]] == max(LEVELS[other.name])
    colours = np.array([to_hex(colour) for colour in closed.get_facecolors()])
    assert set(colours[high.to_numpy()]) == {to_hex(style.LEVELS(1.0))}
    assert to_hex(style.LEVELS(1.0)) not in colours[~high.to_numpy()]


def test_dependence_of_a_cause_that_is_never_on_says_so(grid):
    table = grid[grid.initial_pose == 1.0]
    figure, caption = drawn(DEPENDENCE[0], table)
    assert figure.axes[0].texts[0].get_text() == "initial pose scale is never on."
    assert "Apartment 6–7" in caption


def test_an_unknown_figure_is_refused(grid):
    with pytest.raises(KeyError):
        figures.draw("dependence_sensor_noise_by_partial_overlap", grid, None, STUDY)


def test_pairs_are_drawn_in_order_with_medians_and_a_a_values(fixed):
    figure, _ = drawn("pairs", fixed)
    for axes, name in zip(figure.axes, [*(f"phi_{n}" for n in THREE), "f"], strict=True):
        points = [line for line in axes.lines if line.get_marker() == "o"]
        values = np.concatenate([line.get_xydata() for line in points])
        values = values[np.argsort(values[:, 0])]
        assert values[:, 1] == pytest.approx(fixed[name].to_numpy())
        bars = [line for line in axes.lines if line.get_marker() == "None"]
        medians = [line.get_ydata()[0] for line in bars if line.get_linewidth() == 1.5]
        assert medians == pytest.approx([fixed[name][:2].median(), fixed[name][2]])
    again = next(line for line in figure.axes[-1].lines if "A/A value" in line.get_label())
    assert again.get_ydata() == pytest.approx([0.3] * 3)


def test_a_cause_has_its_colour_in_the_strips():
    study = study_of(SEVEN)
    figure, _ = drawn("pairs", fixed_of(SEVEN), study)
    for axes, cause in zip(figure.axes, study.players, strict=False):
        points = [line for line in axes.lines if line.get_marker() == "o"]
        assert {line.get_markeredgecolor() for line in points} == {cause.colour}


# --- any number of causes, any estimator ----------------------------------------------------------


def every_figure(study, grid, fixed):
    """(name, table) of every kind of figure of a study."""
    names = ("summary", "waterfall", "interactions", *list(study.dependence_figures)[-1:])
    return [*((name, grid) for name in names), ("pairs", fixed)]


def overlapping(texts):
    """Couples of texts whose boxes lie over one another; those of slanted ones always do."""
    upright = [t for t in texts if t.get_text().strip() and t.get_rotation() % 90 == 0]
    boxes = [(text.get_text(), text.get_window_extent()) for text in upright]
    return [
        (a, b)
        for k, (a, box) in enumerate(boxes)
        for b, other in boxes[k + 1 :]
        if box.shrunk(0.98, 0.9).overlaps(other.shrunk(0.98, 0.9))
    ]


def labels_of(figure):
    """All texts that are shown, of ticks those within the axis."""
    texts = []
    for axes in figure.axes:
        texts += [axes.xaxis.label, axes.yaxis.label, axes.title, *axes.texts]
        for axis, ends in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            for tick in axis.get_major_ticks():
                if min(ends) <= tick.get_loc() <= max(ends):
                    texts.append(tick.label2 if tick.label2.get_visible() else tick.label1)
    return [text for text in texts if text.get_visible()]


@pytest.mark.parametrize("number", OF_NUMBER)
def test_no_label_covers_another_or_is_cut_off(number):
    study = study_of(OF_NUMBER[number])
    fixed = fixed_of(study.causes)
    for name, table in every_figure(study, grid_of(study.causes), fixed):
        figure, _ = drawn(name, table, study)
        labels = labels_of(figure)
        assert overlapping(labels) == [], name
        size = figure.bbox
        labels += [text for legend in figure.legends for text in legend.get_texts()]
        for text in (text for text in labels if text.get_text().strip()):
            box = text.get_window_extent()
            assert box.x0 >= -1 and box.x1 <= size.x1 + 1, (name, text.get_text())
            assert box.y0 >= -1 and box.y1 <= size.y1 + 1, (name, text.get_text())
        plt.close(figure)


@pytest.mark.parametrize("name", ["summary", "waterfall"])
def test_a_row_is_as_high_whatever_the_number_of_causes(name):
    heights = {}
    for number, causes in OF_NUMBER.items():
        figure, _ = drawn(name, grid_of(causes), study_of(causes))
        assert figure.get_figwidth() == style.PAGE
        heights[number] = figure.get_figheight()
    steps = [(heights[b] - heights[a]) / (b - a) for a, b in ((1, 2), (2, 3), (3, 5), (5, 7))]
    assert steps == pytest.approx([style.ROW] * 4)


def test_what_is_never_on_is_not_drawn():
    study = study_of(THREE)
    table = grid_of(THREE)
    table = table[table.partial_overlap == 0]
    waterfall = {**WATERFALL, "partial_overlap": 0.0}
    study = study_of(THREE, waterfall=waterfall)
    for name in ("summary", "waterfall", "interactions", "pairs"):
        figure, caption = drawn(name, table, study)
        shown = " ".join(text.get_text() for text in labels_of(figure))
        assert "noise" in shown and "partial overlap" not in shown and "λ" not in shown
        assert "λ" not in caption


def test_nothing_on_is_said_by_every_figure():
    table = fixed_of(THREE[:1]).assign(sensor_noise=0.0)
    study = study_of(THREE[:1], waterfall={"sensor_noise": 0.0})
    for name in ("summary", "waterfall", "interactions"):
        rows = table.iloc[:1] if name == "waterfall" else table
        figure, _ = drawn(name, rows, study)
        assert figure.axes[0].texts[0].get_text() == "Nothing was perturbed."
    assert len(drawn("pairs", table, study)[0].axes) == 1


@pytest.mark.parametrize("number", OF_NUMBER)
def test_without_intervals_nothing_claims_to_be_insignificant(number):
    study = study_of(OF_NUMBER[number], kind="closed_form")
    grid, fixed = (of_covariances(make(study.causes)) for make in (grid_of, fixed_of))
    for name, table in every_figure(study, grid, fixed):
        figure, _ = drawn(name, table, study)
        texts = " ".join(text.get_text() for text in labels_of(figure))
        assert "≠" not in texts and "nan" not in texts and "[n" not in texts.replace("[nats]", "")
        for axes in figure.axes:
            assert all(patch.get_hatch() is None for patch in axes.patches)
            markers = [line for line in axes.lines if line.get_marker() == "o"]
            for line in markers:
                assert len(line.get_xdata()) == 0 or line.get_markerfacecolor() != "white"
        legends = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
        assert not any(word in " ".join(legends) for word in ("floor", "A/A", "interval"))
        plt.close(figure)


def test_dots_without_interval_are_closed(grid):
    table = of_covariances(grid)
    study = study_of(THREE, kind="closed_form", dependence=STUDY.dependence)
    axes = drawn(DEPENDENCE[0], table, study)[0].axes[0]
    closed, opened = (c for c in axes.collections if isinstance(c, PathCollection))
    assert (len(dots_of(closed)), len(dots_of(opened))) == (len(table), 0)


def test_a_single_missing_interval_is_drawn_closed(grid):
    row = grid.index[contains_zero(grid, "phi_sensor_noise")][0]
    closed = []
    for missing in (False, True):
        if missing:
            grid.loc[row, ["phi_sensor_noise_low", "phi_sensor_noise_high"]] = np.nan
        axes = drawn(DEPENDENCE[0], grid)[0].axes[0]
        closed += [len(dots_of(next(c for c in axes.collections if isinstance(c, PathCollection))))]
    assert closed[1] == closed[0] + 1


# --- labels, bytes, sizes -------------------------------------------------------------------------


@pytest.mark.parametrize("reading, unit", [("kl", "nats"), ("translation_rmse", "m")])
def test_every_label_has_its_unit(grid, fixed, reading, unit):
    study = study_of(THREE, divergence=reading, dependence=STUDY.dependence, waterfall=WATERFALL)
    of_causes = {cause.label() for cause in study.players}
    for table, names in ((grid, GRID_FIGURES), (fixed, FIXED_FIGURES)):
        for name in names:
            figure, _ = drawn(name, table, study)
            labels = [axes.get_xlabel() for axes in figure.axes]
            labels += [axes.get_ylabel() for axes in figure.axes]
            labels = [label for label in labels if label and not label.startswith("level")]
            assert labels
            for label in labels:
                of_cause = label.removesuffix(": a lane for each level") in of_causes
                assert of_cause or f"[{unit}]" in label, (name, label)


def test_same_table_same_bytes(grid, fixed, tmp_path):
    for table, names in ((grid, GRID_FIGURES), (fixed, FIXED_FIGURES)):
        for name in names:
            for attempt in "ab":
                figure, _ = figures.draw(name, table, None, STUDY)
                style.save(figure, tmp_path / f"{attempt}.png", tmp_path / f"{attempt}.svg")
                plt.close(figure)
            for kind in ("png", "svg"):
                first, second = ((tmp_path / f"{x}.{kind}").read_bytes() for x in "ab")
                assert first == second, (name, kind)
    assert "<dc:date>" not in (tmp_path / "a.svg").read_text()


def test_a_thousand_dots_make_a_light_file(tmp_path):
    levels = {name: np.linspace(low, high, 10) for name, (low, *_, high) in LEVELS.items()}
    for name in ("summary", DEPENDENCE[0]):
        figure, _ = figures.draw(name, shap_table(levels), None, STUDY)
        style.save(figure, tmp_path / "figure.svg", tmp_path / "figure.png")
        assert (tmp_path / "figure.svg").stat().st_size < 500_000
        assert (tmp_path / "figure.png").stat().st_size < 500_000


# --- rows without values --------------------------------------------------------------------------


def test_a_pair_without_values_is_left_out_and_named(fixed):
    table = without_value(fixed, [1], "overlap ratio 0.0800 is not above 0.1")
    for name in FIXED_FIGURES:
        _, caption = drawn(name, table)
        assert "Not registered: Apartment 1–2 (overlap ratio 0.0800 is not above 0.1)." in caption
    figure, _ = drawn("pairs", table)
    marks = [line for line in figure.axes[0].lines if line.get_label() == "no value"]
    assert marks[0].get_xdata() == pytest.approx([1])


@pytest.mark.parametrize("name", GRID_FIGURES)
def test_a_figure_with_nothing_to_show_says_so(grid, name):
    figure, caption = drawn(name, without_value(grid, grid.index, "too little overlap"))
    shown = " ".join(text.get_text() for text in figure.axes[0].texts)
    assert "o value" in shown or "has a value" in shown
    assert "too little overlap" in caption


def test_a_figure_of_pairs_with_nothing_to_show_says_so(fixed):
    figure, _ = drawn("pairs", without_value(fixed, fixed.index, "too little overlap"))
    assert figure.axes[0].texts[0].get_text() == "No pair has a value."


def test_waterfall_of_two_pairs_is_refused(grid):
    with pytest.raises(ValueError, match="shows one instance of one pair, found 2"):
        figures.draw("waterfall", pd.concat([grid, grid]), None, STUDY)


# --- as large as the page's text ------------------------------------------------------------------


@pytest.mark.parametrize("number", OF_NUMBER)
def test_type_is_as_large_as_that_of_the_page(number):
    study = study_of(OF_NUMBER[number])
    for name, table in every_figure(study, grid_of(study.causes), fixed_of(study.causes)):
        figure, _ = drawn(name, table, study)
        assert figure.get_figwidth() == style.PAGE, name
        texts = labels_of(figure) + [t for leg in figure.legends for t in leg.get_texts()]
        assert min(text.get_fontsize() for text in texts) >= style.SMALL, name
        plt.close(figure)


def test_few_pairs_have_a_linear_axis_unless_one_hides_the_others(fixed):
    figure, caption = drawn("pairs", fixed)
    assert {axes.get_yscale() for axes in figure.axes} == {"linear"}
    assert "logarithmic" not in caption
    fixed.loc[1, "f"] = 500.0
    figure, caption = drawn("pairs", fixed)
    assert {axes.get_yscale() for axes in figure.axes} == {"symlog"}
    assert "The axis is linear up to 1 and logarithmic beyond." in caption
