"""The picture and the page of one pair: its scans, what is removed from them, and its poses."""

import re
from html import unescape

import numpy as np
import pandas as pd
import pytest
from known_results import (
    ALL_LEVELS,
    SEVEN,
    STUDY,
    THREE,
    WATERFALL,
    pair_of_scans,
    runs_table,
    study_of,
)
from matplotlib.patches import Ellipse

from icpshap.causes import named
from icpshap.explanation.method import Method
from icpshap.report.figures import scene
from icpshap.tables import XI

METHOD = Method()
LENGTH = 3.0  # m
CLEAN = {cause.name: cause.off for cause in named(THREE)}
PAIR = pair_of_scans()
EVERY_REFERENCE_POINT = np.ones(len(PAIR.reference), dtype=bool)
KEPT = np.arange(len(PAIR.source)) % 20 > 0


@pytest.fixture
def shown():
    runs = runs_table([CLEAN, WATERFALL])
    return scene.make_scene(PAIR, EVERY_REFERENCE_POINT, KEPT, runs, WATERFALL, METHOD, LENGTH)


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


def test_scene_removes_what_the_causes_remove(shown):
    parts = scene.clouds(shown)
    assert list(parts) == [
        "reference",
        "source alone",
        "source overlapping",
        "removed by partial overlap",
    ]
    assert len(parts["removed by partial overlap"][0]) == (~KEPT).sum()
    number = sum(len(points) for points, _ in parts.values())
    assert number == len(PAIR.reference) + len(PAIR.source)


def test_every_cause_that_removes_points_of_either_scan_is_named():
    values = {name: ALL_LEVELS[name][-1] for name in SEVEN}
    kept_reference = np.arange(len(PAIR.reference)) % 10 > 0
    both = scene.make_scene(PAIR, kept_reference, KEPT, None, values, METHOD, LENGTH)
    removed, _ = scene.clouds(both)["removed by partial overlap and under-constrained scene"]
    assert len(removed) == (~kept_reference).sum() + (~KEPT).sum()
    text = scene.caption(both, study_of(SEVEN), pair_row())
    assert "partial overlap λ = 0.05 and under-constrained scene u = 0.9 remove." in text


def test_nothing_is_removed_where_no_such_cause_is_on():
    values = {"sensor_noise": 0.1, "partial_overlap": 0.0}
    everything = np.ones(len(PAIR.source), dtype=bool)
    runs = runs_table([{"sensor_noise": 0.0, "partial_overlap": 0.0}, values])
    shown = scene.make_scene(PAIR, EVERY_REFERENCE_POINT, everything, runs, values, METHOD, LENGTH)
    assert not any(name.startswith("removed") for name in scene.clouds(shown))
    text = scene.caption(shown, study_of(THREE), pair_row())
    assert "remove" not in text and "results at sensor noise σ = 0.1 m, with" in text
    scene.picture(shown)


def test_picture_shows_every_run_and_marks_wrong_basins(shown):
    figure = scene.picture(shown)
    overview = figure.subfigs[1].axes[0]
    count = {line.get_label(): len(line.get_xdata()) for line in overview.lines}
    assert count["clean"] == count["perturbed"] == 56
    assert count["clean, wrong basin"] == count["perturbed, wrong basin"] == 4
    assert count["initial pose"] == 60
    assert re.fullmatch(r"translation [xyz] \[cm\]", overview.get_xlabel())
    text = scene.caption(shown, STUDY, pair_row())
    assert "4 clean, 4 perturbed" in text and "Pose errors of 60 runs" in text
    levels = "sensor noise σ = 0.1 m, initial pose scale s = 1.5, partial overlap λ = 0.05"
    assert f"results at {levels}, with ellipses" in text


def test_the_second_clean_sample_and_replicates_are_not_shown():
    runs = runs_table([CLEAN, WATERFALL])
    more = pd.concat([runs, runs.assign(again=True), runs.assign(replicate=1)])
    shown = scene.make_scene(PAIR, EVERY_REFERENCE_POINT, KEPT, more, WATERFALL, METHOD, LENGTH)
    assert len(shown.clean) == len(shown.perturbed) == 60


def test_a_run_that_failed_has_no_pose():
    runs = runs_table([CLEAN, WATERFALL])
    runs.loc[[5, 6], [*XI, "status"]] = np.nan, *[np.nan] * 5, "too_few_links"
    shown = scene.make_scene(PAIR, EVERY_REFERENCE_POINT, KEPT, runs, WATERFALL, METHOD, LENGTH)
    assert (len(shown.clean), len(shown.perturbed)) == (58, 60)
    scene.picture(shown)


def test_ellipses_hold_the_covariance(shown):
    overview = scene.picture(shown).subfigs[1].axes[0]
    perturbed = next(patch for patch in overview.patches if isinstance(patch, Ellipse))
    # The two translations that vary most are y and z.
    values = 100 * shown.perturbed[XI].to_numpy()[:, 4:]
    ends = perturbed.get_patch_transform().transform([[1, 0], [0, 1], [-1, 0], [0, -1]])
    deviation = ends - values.mean(axis=0)
    distance = np.einsum("ki,ij,kj->k", deviation, np.linalg.inv(np.cov(values.T)), deviation)
    assert distance == pytest.approx(5.991)


def test_a_sample_counts_as_much_as_it_weighs():
    values = np.random.default_rng(0).normal(size=(20, 2))
    weight = np.repeat([0.0, 2.0], 10)
    mean, variances, _ = scene._gaussian(values, weight)
    twice = np.repeat(values[10:], 2, axis=0)
    assert mean == pytest.approx(twice.mean(axis=0))
    assert variances == pytest.approx(np.linalg.eigvalsh(np.cov(twice.T)))


def test_a_pair_that_was_not_registered_is_still_shown():
    runs = runs_table([WATERFALL]).iloc[:0]
    empty = scene.make_scene(PAIR, EVERY_REFERENCE_POINT, KEPT, runs, WATERFALL, METHOD, LENGTH)
    row = pair_row(
        reason="overlap ratio 0.08 is not above 0.1", warning="looks wrong. Hint: units."
    )
    text = scene.caption(empty, STUDY, row)
    assert "Not registered: overlap ratio 0.08 is not above 0.1." in text
    assert text.endswith("Warning: looks wrong. Hint: units.")
    figure = scene.picture(empty)
    assert figure.subfigs[1].texts[0].get_text() == "This pair was not registered."
    assert "translation" in scene.page(empty, "a pair", text)


def test_an_estimator_without_samples_says_so():
    without = scene.make_scene(PAIR, EVERY_REFERENCE_POINT, KEPT, None, WATERFALL, METHOD, LENGTH)
    figure = scene.picture(without)
    assert figure.subfigs[1].texts[0].get_text() == "The estimator returns no pose samples."
    for say in (scene.caption, scene.page_caption):
        text = say(without, study_of(THREE, kind="closed_form"), pair_row())
        assert "The estimator returns no pose samples." in text
        assert "run" not in text and "basin" not in text
    assert "translation" in scene.page(without, "a pair", text)


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


@pytest.mark.parametrize("shape", scene.PLACES)
def test_panels_of_the_page_use_the_window_and_do_not_overlap(shape):
    places = np.array(list(scene.PLACES[shape].values()))  # of panels x, y, each from and to
    assert places.min() == 0 and places.max() == 1
    assert np.diff(places, axis=2).prod(axis=(1, 2)).sum() > 0.9
    apart = (places[:, None, :, 0] >= places[None, :, :, 1]).any(axis=2)
    assert (apart | apart.T | np.eye(len(places), dtype=bool)).all()


def test_a_title_from_the_configuration_cannot_break_the_page(shown):
    title, text = "<script>alert(1)</script> 6–7", "a </p><script>alert(2)</script> & more"
    page = scene.page(shown, title, text)
    assert "<script>alert" not in page
    assert (
        re.search(r"<title>(.*?)</title>", page)[1] == "&lt;script&gt;alert(1)&lt;/script&gt; 6–7"
    )
    assert unescape(re.search(r"<p>(.*?)</p></details>", page)[1]) == text
