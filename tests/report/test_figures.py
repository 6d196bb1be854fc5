"""Figures show what the tables hold, say what they are, and come out the same each time."""

import re

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from known_results import FIXED, LEVELS, STUDY, WATERFALL, runs_table, shap_table, without_value
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from matplotlib.patches import Ellipse, FancyArrow

from icpshap import config as settings
from icpshap.causes import NAMES, SOURCES
from icpshap.estimators import perturb as perturbation
from icpshap.report import captions, figures
from icpshap.report.figures import scene, style
from icpshap.tables import XI

PAIRS = (("apartment", 0, 1), ("apartment", 1, 2), ("eth", 0, 1))
DEPENDENCE = (
    "dependence_sensor_noise_by_initial_pose",
    "dependence_initial_pose_by_partial_overlap",
    "dependence_partial_overlap_by_initial_pose",
)
GRID_FIGURES = ("summary", "waterfall", "interactions", *DEPENDENCE)
FIXED_FIGURES = ("summary", "interactions", "pairs")


@pytest.fixture
def grid():
    return shap_table()


@pytest.fixture
def fixed():
    return shap_table(FIXED, PAIRS)


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def dots_of(collection):
    return np.asarray(collection.get_offsets())


def dots(axes):
    """Positions of all dots that a scatter drew."""
    parts = [c for c in axes.collections if isinstance(c, PathCollection)]
    return np.concatenate([dots_of(part) for part in parts])


def drawn(name, table, study=STUDY):
    figure, caption = figures.draw(name, table, study)
    figure.canvas.draw()
    return figure, caption


# --- what is drawn is what the table holds --------------------------------------------------------


def test_summary_has_a_dot_for_every_value(grid):
    figure, _ = drawn("summary", grid)
    axes = figure.axes[0]
    found = dots(axes)
    for row, label in enumerate(text.get_text() for text in axes.get_yticklabels()):
        source = next(s for s in SOURCES if label.startswith(s.label))
        x = found[np.abs(found[:, 1] - row) < 0.5, 0]
        assert np.sort(x) == pytest.approx(np.sort(grid[f"phi_{source.name}"]))


def test_summary_counts_what_can_be_told_from_zero(grid):
    figure, _ = drawn("summary", grid)
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    on = grid[grid.sensor_noise > 0]
    expected = f"{on.phi_sensor_noise_significant.sum()} of {len(on)} ≠ 0"
    assert f"sensor noise σ [m]\n{expected}" in labels


def test_waterfall_arrows_add_up_to_f(grid):
    row = captions.instance(grid, WATERFALL).iloc[0]
    figure, caption = drawn("waterfall", grid)
    axes = figure.axes[0]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrow)]
    values = sorted((row[f"phi_{name}"] for name in NAMES), key=abs)
    ends = np.concatenate([[0], np.cumsum(values)])
    for arrow, start, end in zip(arrows, ends[:-1], ends[1:], strict=True):
        x = arrow.get_xy()[:, 0]
        assert (x.min(), x.max()) == pytest.approx((min(start, end), max(start, end)))
    assert ends[-1] == pytest.approx(row.f)
    assert f"f = {row.f:.2f} nats" in caption


def test_waterfall_intervals_stand_where_the_arrow_starts(grid):
    row = captions.instance(grid, WATERFALL).iloc[0]
    axes = drawn("waterfall", grid)[0].axes[0]
    intervals = [line.get_xdata() for line in axes.lines if line.get_linewidth() == 1.2]
    start = 0.0
    ranked = sorted(NAMES, key=lambda name: abs(row[f"phi_{name}"]))
    for interval, name in zip(intervals, ranked, strict=True):
        expected = [start + row[f"phi_{name}_low"], start + row[f"phi_{name}_high"]]
        assert list(interval) == pytest.approx(expected)
        start += row[f"phi_{name}"]


def test_waterfall_hatches_what_cannot_be_told_from_zero(grid):
    grid["phi_sensor_noise_significant"] = False
    for name in ("initial_pose", "partial_overlap"):
        grid[f"phi_{name}_significant"] = True
    axes = drawn("waterfall", grid)[0].axes[0]
    labels = [text.get_text() for text in axes.get_yticklabels()]
    arrows = [patch for patch in axes.patches if isinstance(patch, FancyArrow)]
    for label, arrow in zip(labels, arrows, strict=True):
        assert (arrow.get_hatch() is not None) == label.startswith("sensor noise")


def test_noise_floor_and_a_a_value_are_drawn(grid):
    axes = drawn("waterfall", grid)[0].axes[0]
    handles, labels = axes.get_legend_handles_labels()
    marks = dict(zip(labels, handles, strict=True))
    assert marks["noise floor of f (95 %)"].get_width() == pytest.approx(0.368)
    assert marks["A/A value, 0.30"].get_xdata()[0] == pytest.approx(0.3)


def test_an_a_a_value_far_above_f_does_not_squash_the_arrows(grid):
    before = drawn("waterfall", grid)[0].axes[0].get_xlim()
    axes = drawn("waterfall", grid.assign(f_again=254888.2))[0].axes[0]
    assert "A/A value, 2.55e+05 (off the axis)" in axes.get_legend_handles_labels()[1]
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
    source, _ = captions.dependence_sources(name)
    phi = grid[f"phi_{source.name}"]
    axes = drawn(name, grid)[0].axes[0]
    closed, opened = (c for c in axes.collections if isinstance(c, PathCollection))
    significant = grid[f"phi_{source.name}_significant"]
    assert dots_of(closed)[:, 1] == pytest.approx(phi[significant].to_numpy())
    assert dots_of(opened)[:, 1] == pytest.approx(phi[~significant].to_numpy())
    assert len(opened.get_facecolors()) == 0
    # A dot stays nearer to its own level than to any other.
    levels = np.array(LEVELS[source.name])
    nearest = np.abs(dots_of(closed)[:, [0]] - levels).argmin(axis=1)
    assert levels[nearest] == pytest.approx(grid[source.name][significant].to_numpy())
    median = next(line for line in axes.lines if line.get_marker() == "_")
    assert median.get_ydata() == pytest.approx(phi.groupby(grid[source.name]).median().to_numpy())


def test_dependence_colour_is_the_other_source(grid):
    source, other = captions.dependence_sources(DEPENDENCE[0])
    axes = drawn(DEPENDENCE[0], grid)[0].axes[0]
    closed = next(c for c in axes.collections if isinstance(c, PathCollection))
    high = grid[other.name][grid[f"phi_{source.name}_significant"]] == max(LEVELS[other.name])
    colours = np.array([to_hex(colour) for colour in closed.get_facecolors()])
    assert set(colours[high.to_numpy()]) == {to_hex(style.LEVELS(1.0))}
    assert to_hex(style.LEVELS(1.0)) not in colours[~high.to_numpy()]


def test_interaction_map_holds_medians_over_the_third_source(grid):
    figure, _ = drawn("interactions", grid)
    mesh = figure.axes[0].collections[0].get_array()
    at = grid[(grid.sensor_noise == 0.1) & (grid.initial_pose == 1.5)]
    expected = at.interaction_sensor_noise_initial_pose.median()
    assert np.ma.getdata(mesh).reshape(3, 3)[1, 2] == pytest.approx(expected)


def test_pairs_are_drawn_in_order_with_medians_and_a_a_values(fixed):
    figure, _ = drawn("pairs", fixed)
    for axes, name in zip(figure.axes, [*(f"phi_{n}" for n in NAMES), "f"], strict=True):
        points = [line for line in axes.lines if line.get_marker() == "o"]
        values = np.concatenate([line.get_xydata() for line in points])
        values = values[np.argsort(values[:, 0])]
        assert values[:, 1] == pytest.approx(fixed[name].to_numpy())
        bars = [line for line in axes.lines if line.get_marker() == "None"]
        medians = [line.get_ydata()[0] for line in bars if line.get_linewidth() == 1.5]
        assert medians == pytest.approx([fixed[name][:2].median(), fixed[name][2]])
    again = next(line for line in figure.axes[-1].lines if line.get_label() == "A/A value")
    assert again.get_ydata() == pytest.approx([0.3] * 3)


# --- labels, bytes, sizes -------------------------------------------------------------------------


@pytest.mark.parametrize("reading, unit", [("kl", "nats"), ("translation_rmse", "m")])
def test_every_label_has_its_unit(grid, fixed, reading, unit):
    study = captions.Study(**{**STUDY.__dict__, "divergence": reading})
    of_sources = {source.label for source in SOURCES}
    for table, names in ((grid, GRID_FIGURES), (fixed, FIXED_FIGURES)):
        for name in names:
            figure, _ = drawn(name, table, study)
            labels = [axes.get_xlabel() for axes in figure.axes]
            labels += [axes.get_ylabel() for axes in figure.axes]
            labels = [label for label in labels if label and label != "value of the source"]
            assert labels
            for label in labels:
                assert label in of_sources or label.endswith(f"[{unit}]"), (name, label)


def test_same_table_same_bytes(grid, fixed, tmp_path):
    for table, names in ((grid, GRID_FIGURES), (fixed, FIXED_FIGURES)):
        for name in names:
            for attempt in "ab":
                np.random.random(7)  # noqa: NPY002 - shap jitters with this generator
                figure, _ = figures.draw(name, table, STUDY)
                style.save(figure, tmp_path / f"{attempt}.png", tmp_path / f"{attempt}.svg")
                plt.close(figure)
            for kind in ("png", "svg"):
                first, second = ((tmp_path / f"{x}.{kind}").read_bytes() for x in "ab")
                assert first == second, (name, kind)
    assert "<dc:date>" not in (tmp_path / "a.svg").read_text()


def test_drawing_leaves_the_global_generator_alone(grid):
    np.random.seed(3)  # noqa: NPY002
    expected = np.random.random()  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    figures.draw("summary", grid, STUDY)
    assert np.random.random() == expected  # noqa: NPY002


def test_a_thousand_dots_make_a_light_file(tmp_path):
    levels = {name: np.linspace(low, high, 10) for name, (low, *_, high) in LEVELS.items()}
    for name in ("summary", DEPENDENCE[0]):
        figure, _ = figures.draw(name, shap_table(levels), STUDY)
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
        figures.draw("waterfall", pd.concat([grid, grid]), STUDY)


# --- captions -------------------------------------------------------------------------------------


def test_caption_says_what_intervals_hold_for(grid):
    assert f"95 % intervals are taken over runs, conditional on {captions.DRAWS}." in (
        captions.caption("summary", grid, STUDY)
    )
    text = captions.caption("summary", grid.assign(interval_over="replicates"), STUDY)
    assert "95 % intervals are taken over replicates." in text


def test_caption_counts_negative_values(grid):
    phi = pd.concat([captions.present(grid, s)[f"phi_{s.name}"] for s in SOURCES])
    significant = (phi.abs() > 0.5).sum()
    negative, below = (phi < 0).sum(), (phi < -0.5).sum()
    (sentence,) = captions.significance(grid)
    assert sentence.startswith(f"{significant} of {len(phi)} Shapley values")
    assert f"{negative} are negative, {below} of these significantly" in sentence


def test_caption_gives_values_with_and_without_wrong_basins(grid):
    grid["n_wrong_basin"] = 3
    on = captions.present(grid, SOURCES[0])
    first, second = captions.basins(grid, STUDY)
    assert "3 of 100 in the median, at most 3; kept." in first
    both = on.phi_sensor_noise.median() + 0.25
    assert f"sensor noise {both:.2f} and {both:.2f}" in second


def test_warning_comes_with_the_sensitivity_to_the_floor(grid):
    grid["warning"] = "the floor makes up 90% of the clean variance in one direction"
    lines = captions.warnings(grid, STUDY)
    assert f"Apartment 6–7 ({len(grid)} instances): the floor makes up 90%" in lines[0]
    assert "sensor noise 0.25 and 0.25" in lines[1]


def test_a_pair_whose_clean_samples_differ_is_a_warning(grid):
    assert captions.warnings(grid, STUDY) == []
    (line,) = captions.warnings(grid.assign(f_again=364.68), STUDY)
    assert line.startswith("In 1 of 1 pairs two clean samples differ by more than the noise floor")
    assert "f = 364.68 nats at most" in line


def test_noise_floor_sentence(grid):
    (sentence,) = captions.noise_floor(grid)
    assert "mean 0.23 and the 95 % quantile 0.37" in sentence
    assert "it is 0.30 (A/A)" in sentence


def test_additive_variances_interact_by_the_logarithm_alone():
    def f(variance):
        return 6 * 0.5 * (1 / variance - 1 + np.log(variance))

    assert captions.additive_interaction(3.0) == pytest.approx(f(7) - 2 * f(4) + f(1))
    assert captions.additive_interaction(3.0) < 0


def test_finding_names_the_largest_source(fixed):
    for name, value in zip(NAMES, (1.0, 5.0, 2.0), strict=True):
        fixed[f"phi_{name}"] = value
        fixed[f"phi_{name}_significant"] = True
    text = captions.finding(fixed, STUDY)
    assert "initial pose scale contributes most to the uncertainty, φ = 5.00 nats" in text
    assert "an_experiment (3 pairs of Apartment, ETH)" in text
    for name in NAMES:
        fixed[f"phi_{name}_significant"] = name != "initial_pose"
    assert "partial overlap contributes most" in captions.finding(fixed, STUDY)
    fixed[[f"phi_{name}_significant" for name in NAMES]] = False
    assert "no uncertainty source can be told from zero in most" in captions.finding(fixed, STUDY)
    nothing = without_value(fixed, fixed.index, "too little overlap")
    assert captions.finding(nothing, STUDY).endswith("no pair has a value.")


# --- scans and poses ------------------------------------------------------------------------------

STREAMS = perturbation.Streams(1, "apartment", 6, 7)


@pytest.fixture
def shown(room_pair):
    clean = {source.name: source.off for source in SOURCES}
    return scene.make_scene(room_pair, runs_table([clean, WATERFALL]), WATERFALL, STREAMS)


def pair_row(**changes):
    row = {
        "sequence": "apartment",
        "reference": 6,
        "source": 7,
        "overlap": 0.8,
        "reason": "",
        "warning": "",
    }
    return next(pd.DataFrame([row | changes]).itertuples())


def test_scene_removes_what_the_registration_removes(shown, room_pair):
    removed = round(WATERFALL["partial_overlap"] * len(room_pair.reference))
    assert (~shown.kept).sum() == removed
    parts = scene.clouds(shown)
    assert len(parts["removed by λ"][0]) == removed
    assert sum(len(points) for points, _ in parts.values()) == len(room_pair.reference) + len(
        room_pair.source
    )


def test_picture_shows_every_run_and_marks_wrong_basins(shown):
    figure = scene.picture(shown)
    overview = figure.subfigs[1].axes[0]
    count = {line.get_label(): len(line.get_xdata()) for line in overview.lines}
    assert count["clean"] == count["perturbed"] == 56
    assert count["clean, wrong basin"] == count["perturbed, wrong basin"] == 4
    assert count["initial pose"] == 60
    assert re.fullmatch(r"translation [xyz] \[cm\]", overview.get_xlabel())
    assert "4 clean, 4 perturbed" in scene.caption(shown, STUDY, pair_row())


def test_ellipses_hold_the_covariance(shown):
    overview = scene.picture(shown).subfigs[1].axes[0]
    perturbed = next(patch for patch in overview.patches if isinstance(patch, Ellipse))
    # The two translations that vary most are y and z.
    values = 100 * shown.perturbed[XI].to_numpy()[:, 4:]
    ends = perturbed.get_patch_transform().transform([[1, 0], [0, 1], [-1, 0], [0, -1]])
    deviation = ends - values.mean(axis=0)
    distance = np.einsum("ki,ij,kj->k", deviation, np.linalg.inv(np.cov(values.T)), deviation)
    assert distance == pytest.approx(5.991)


def test_a_pair_that_was_not_registered_is_still_shown(room_pair):
    runs = runs_table([WATERFALL]).iloc[:0]
    empty = scene.make_scene(room_pair, runs, WATERFALL, STREAMS)
    text = scene.caption(empty, STUDY, pair_row(reason="overlap ratio 0.08 is not above 0.1"))
    assert "Not registered: overlap ratio 0.08 is not above 0.1." in text
    figure = scene.picture(empty)
    assert figure.subfigs[1].texts[0].get_text() == "This pair was not registered."
    assert "translation" in scene.page(empty, "a pair", text)


def test_thinning_keeps_one_point_of_a_voxel():
    points = np.random.default_rng(0).uniform(0, 1, (5000, 3))
    left = scene.thin(points, 300)
    assert 50 < len(left) <= 300
    assert set(map(tuple, left)) <= set(map(tuple, points))
    assert scene.thin(points, 5000) is points


def test_page_is_self_contained_small_and_the_same_each_time(shown):
    page = scene.page(shown, "Apartment 6–7", "text")
    assert page == scene.page(shown, "Apartment 6–7", "text")
    assert len(page.encode()) < 10_000_000
    assert not re.search(r'<(script|link|img|iframe)[^>]*(src|href)="https?:', page)
    for name in ("reference", "removed by", "perturbed, wrong basin"):
        assert f'"name":"{name}' in page


# --- configuration --------------------------------------------------------------------------------


def test_a_scene_must_be_one_of_the_pairs(config):
    block = config["experiments"]["different_perturbations"]
    block["scenes"] = [{"sequence": "apartment", "reference": 3, "source": 4}]
    message = (
        "experiments.different_perturbations.scenes: apartment 3, 4 is not one of the "
        "experiment's pairs. Hint: list it under pairs too"
    )
    with pytest.raises(settings.SettingsError, match=re.escape(message)):
        settings.load(config)
    block["pairs"] += block["scenes"]
    block["figures"] = ["summary"]
    settings.load(config)


def test_a_waterfall_of_several_pairs_is_an_error_of_the_configuration(config):
    config["experiments"]["same_perturbation"]["figures"] += ["waterfall"]
    with pytest.raises(settings.SettingsError, match="waterfall shows one pair, and the exper"):
        settings.load(config)
