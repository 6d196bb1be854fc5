"""The seam: streams, subsamples, and what estimators get of a setting."""

import weakref
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from scipy.stats import kstest

from icpshap import se3
from icpshap.causes import CAUSES
from icpshap.causes.cause import Cause
from icpshap.errors import PerturbationError
from icpshap.estimators import Estimator, perturb
from icpshap.estimators.perturb import Draws, Streams
from icpshap.geometry import nearest_to_cell_centres
from icpshap.plan import Setting

STREAMS = Streams(seed=1, sequence="room", reference=0, source=1)
DEVIATION = np.repeat([np.deg2rad(10), 0.2], 3) / np.sqrt(3)
NAMES = ("sensor_noise", "initial_pose", "partial_overlap")


def draws(pair, names=NAMES, **values):
    estimator = Estimator.of("monte_carlo", values).of_causes(names)
    return Draws(pair, estimator, DEVIATION, STREAMS)


def groups(pair, settings, names=NAMES, **values):
    estimator = Estimator.of("monte_carlo", values).of_causes(names)
    return list(perturb.groups(pair, settings, estimator, DEVIATION, STREAMS))


def test_the_memory_of_subsamples_is_given_back_at_once(room_pair):
    """Not when Python next looks for garbage: those of a large scan are gigabytes."""
    found = draws(room_pair, subsampling_probability=0.5)
    assert len(found.rows(np.ones(len(room_pair.source), dtype=bool), np.arange(3))) == 3
    left = weakref.ref(found)
    del found
    assert left() is None


def test_the_deviation_is_the_root_of_equation_4():
    found = perturb.Perturbation(initial_pose_rotation=9.0, initial_pose_translation=0.6).deviation
    np.testing.assert_allclose(found, np.repeat([np.deg2rad(9.0), 0.6], 3) / np.sqrt(3))


def test_streams_differ_by_every_part_of_their_name():
    names = [
        STREAMS,
        Streams(2, "room", 0, 1),
        Streams(1, "hall", 0, 1),
        Streams(1, "room", 1, 1),
        Streams(1, "room", 0, 2),
        STREAMS.branched("again/"),
    ]
    found = [streams.generator("noise").standard_normal() for streams in names]
    found.append(STREAMS.generator("overlap").standard_normal())
    assert len(set(found)) == len(found)
    assert STREAMS.generator("noise").standard_normal() == found[0]


@pytest.mark.parametrize(
    ("composition", "on_the_right"), [("right", True), ("left_inverse", False)]
)
def test_initial_poses_are_composed_as_the_option_says(room_pair, composition, on_the_right):
    (group,) = groups(room_pair, [Setting.at({})], initial_pose_composition=composition)
    (start,) = group.starts
    T, xi = room_pair.T_reference_source, start.initial_xi
    draw = STREAMS.generator("initial_pose").standard_normal((100, 6))
    np.testing.assert_array_equal(xi, DEVIATION * draw)
    if on_the_right:
        np.testing.assert_allclose(se3.log(se3.inverse(T) @ start.T_initial), xi, atol=1e-12)
    else:
        np.testing.assert_allclose(se3.log(start.T_initial @ se3.inverse(T)), -xi, atol=1e-12)


def test_settings_with_the_same_reference_come_together(room_pair):
    settings = [
        Setting.at(dict(zip(NAMES, values, strict=True)))
        for values in [(0, 1, 0), (0.05, 1, 0), (0, 2, 0), (0.05, 1, 0.1), (0, 1, 0.1)]
    ]
    found = groups(room_pair, settings, noise_draws=2)
    assert [group.noise_draw for group in found] == [0, 1, 0, 1]
    of_clean = [start.setting for start in found[0].starts]
    assert set(of_clean) == {settings[0], settings[2], settings[4]}
    assert [group.runs.tolist() for group in found[:2]] == [list(range(50)), list(range(50, 100))]


def test_starts_with_the_same_source_hold_the_same_array_one_after_the_other(room_pair):
    settings = [
        Setting.at(dict(zip(NAMES, values, strict=True)))
        for values in [(0.05, 1, 0), (0.05, 1, 0.1), (0.05, 2, 0)]
    ]
    (group,) = groups(room_pair, settings)
    starts = list(group.starts)
    assert all(start.source is starts[0].source for start in starts)
    assert len(list(perturb.batches(iter(starts), 10**9, 10**9))) == 1


def test_starts_that_differ_in_their_initial_poses_alone_come_together(room_pair):
    """So that what does not depend on these is estimated once."""
    settings = [
        Setting.at(dict(zip(NAMES, values, strict=True)))
        for values in [(0, 1, 0), (0, 1, 0.1), (0, 2.25, 0), (0, 2.25, 0.1), (0, 9, 0)]
    ]
    (group,) = groups(room_pair, settings)
    found = [[start.setting for start in same] for same in perturb.alike(group.starts)]
    assert found == [settings[0::2], settings[1::2]]


def test_a_start_says_how_its_initial_poses_are_drawn(room_pair):
    setting = Setting.at({"initial_pose": 2.25})
    (group,) = groups(room_pair, [setting], ("initial_pose",))
    (start,) = group.starts
    np.testing.assert_allclose(start.initial_deviation, 1.5 * DEVIATION)
    draw = STREAMS.generator("initial_pose").standard_normal((100, 6))
    np.testing.assert_array_equal(start.initial_xi, start.initial_deviation * draw)


def test_nearby_points_are_no_business_of_the_estimator(room_pair):
    (group,) = groups(room_pair, [Setting.at({})], minimum_range=4.0)
    (start,) = group.starts
    assert np.linalg.norm(group.reference, axis=1).min() > 4.0
    far = np.linalg.norm(room_pair.source, axis=1) > 4.0
    np.testing.assert_array_equal(start.usable, far)
    assert all(far[rows].all() for rows in start.rows)


@pytest.mark.parametrize(("mask", "shifted"), [("frozen", False), ("frozen_in_order", True)])
def test_in_order_a_removed_point_shifts_the_rest(room_pair, mask, shifted):
    given = draws(room_pair, subsampling_mask=mask, subsampling_probability=0.2)
    every = np.ones(len(room_pair.source), dtype=bool)
    without = every.copy()
    without[100] = False
    (before,), (after,) = given.rows(every, [0]), given.rows(without, [0])
    np.testing.assert_array_equal(before[before < 100], after[after < 100])
    common = np.intersect1d(before, after)
    assert (len(common) < 0.7 * len(before)) == shifted


@pytest.mark.parametrize("kept", [{"subsampling_probability": 1.0}, {"subsampling_mask": "frozen"}])
def test_runs_with_the_same_subsample_share_its_rows(room_pair, kept):
    """As many copies as runs would not fit into memory for the full scans of the data sets."""
    usable = np.arange(len(room_pair.source)) > 5
    rows = draws(room_pair, **{"subsampling_probability": 0.2, **kept}).rows(usable, np.arange(100))
    assert len(rows) == 100
    assert all(run is rows[0] for run in rows)
    assert rows[0].min() > 5


def test_subsampling_keeps_rows_with_the_probability_asked_for():
    rows = [perturb.subsample(20_000, 0.05, np.random.default_rng(seed)) for seed in range(50)]
    assert all((np.diff(kept) > 0).all() and kept[0] >= 0 and kept[-1] < 20_000 for kept in rows)
    counts = np.array([len(kept) for kept in rows])
    assert abs(counts.mean() - 1000) < 5 * np.sqrt(950 / 50)
    assert kstest(np.concatenate(rows) / 20_000, "uniform").pvalue > 1e-3


def test_subsampling_of_a_longer_cloud_begins_with_the_same_rows():
    short, long = (perturb.subsample(n, 0.3, np.random.default_rng(4)) for n in (1000, 50_000))
    np.testing.assert_array_equal(short, long[: len(short)])


def test_a_run_of_fewer_than_50_source_points_is_refused_with_their_number(room_pair):
    """3,000 points at 0.1 are 300 of a run; a quarter of them is about 75, a tenth about 30."""
    estimator = Estimator.of("monte_carlo", {"subsampling_probability": 0.1, "runs": 100})
    for rho in (4.0, 10.0):
        setting = Setting.at({"icp_randomness": rho})
        of_setting = estimator.of_causes(["icp_randomness"])
        given = (room_pair, setting, of_setting, STREAMS)
        (group,) = perturb.groups(room_pair, [setting], of_setting, DEVIATION, STREAMS)
        left = np.mean([len(rows) for rows in next(group.starts).rows])
        if rho == 4.0:
            assert left >= perturb.FEWEST_POINTS
            perturb.require_points(*given)
            continue
        expected = (
            r"room, scans 0 and 1: icp_randomness 10 and subsampling_probability 0.1 leave a run "
            rf"{left:.1f} of 3000 source points beyond the minimum range in the mean, expected at "
            r"least 50.\nHint"
        )
        with pytest.raises(PerturbationError, match=expected):
            perturb.require_points(*given)


def test_probability_one_keeps_every_row():
    np.testing.assert_array_equal(perturb.subsample(7, 1, np.random.default_rng(0)), np.arange(7))


# --- causes of every hook together, made for the test ---------------------------------------------


@dataclass(frozen=True)
class Rounded(Cause):
    """Coordinates are rounded to a step: what the scanner does last."""

    name: ClassVar = "rounded"
    order: ClassVar = 5

    def move(self, points, scan, level, draw, streams):
        return np.round(points / level) * level


@dataclass(frozen=True)
class Shadow(Cause):
    """Points of both scans with a small y are lost."""

    name: ClassVar = "shadow"

    def keep(self, pair, scan, level, draw, streams):
        return getattr(pair, scan)[:, 1] > level


@dataclass(frozen=True)
class Thinned(Cause):
    """A run uses every other of its rows."""

    name: ClassVar = "thinned"

    def thin(self, rows, run, level, count, streams):
        return rows[::2]


@pytest.fixture
def more_causes(monkeypatch):
    for cause in (Rounded, Shadow, Thinned):
        monkeypatch.setitem(CAUSES, cause.name, cause)


def test_every_hook_acts(room_pair, more_causes):
    values = {"rounded": 0.01, "sensor_noise": 0.05, "shadow": 2.0, "thinned": 1}
    (group,) = groups(room_pair, [Setting.at(values)], tuple(values), subsampling_probability=0.5)
    (start,) = group.starts
    # Moves act in the reverse order of the tables: the noise first, then what is rounded.
    for points in (group.reference, start.source):
        np.testing.assert_allclose(points, np.round(points, 2), atol=1e-12)
    noise = STREAMS.generator("noise/source/0").standard_normal(room_pair.source.shape)
    np.testing.assert_allclose(start.source, np.round(room_pair.source + 0.05 * noise, 2))
    # Masks are of the raw scans, and those of the reference act on the reference.
    np.testing.assert_array_equal(start.usable, room_pair.source[:, 1] > 2.0)
    assert len(group.reference) == (room_pair.reference[:, 1] > 2.0).sum()
    usable = draws(room_pair, subsampling_probability=0.5).rows(start.usable, [4])
    np.testing.assert_array_equal(start.rows[4], usable[0][::2])


def test_what_changes_the_reference_makes_groups(room_pair, more_causes):
    settings = [Setting.at({"shadow": y, "thinned": t}) for y in (0.0, 2.0) for t in (0, 1)]
    assert len(groups(room_pair, settings, ("shadow", "thinned"))) == 2


def test_rows_that_the_released_code_replaced_cannot_be_masked(room_pair, more_causes):
    setting = Setting.at({"partial_overlap": 0.05, "shadow": 2.0})
    with pytest.raises(PerturbationError, match=r"shadow removes rows .* partial_overlap"):
        (group,) = groups(
            room_pair, [setting], ("partial_overlap", "shadow"), overlap_removal="noisy"
        )
        list(group.starts)


def test_the_released_codes_overlap_acts_though_it_is_not_named(room_pair):
    """At lambda 0 it brings the overlap to a rounded ratio; so it does where nothing is named."""
    overlapping = np.arange(len(room_pair.source)) < 0.854 * len(room_pair.reference)
    pair = replace(room_pair, overlapping=overlapping)
    found = []
    for values in ({"partial_overlap": 0.0}, {}):
        (group,) = groups(pair, [Setting.at(values)], tuple(values), overlap_removal="noisy")
        found.append(next(group.starts).source)
    assert len(found[0]) < len(pair.source)
    np.testing.assert_array_equal(*found)


def test_without_common_random_numbers_the_causes_that_are_on_name_the_draws(room_pair):
    settings = [Setting.at(dict(zip(NAMES, v, strict=True))) for v in [(0, 1, 0), (0, 2, 0)]]
    streams = [g.streams.branch for g in groups(room_pair, settings, common_random_numbers=False)]
    assert streams == ["setting//", "setting/initial_pose=2/"]


def brute_grid(points, side):
    """Rows nearest to the centres of the cells of a grid, by going through them."""
    best = {}
    for row, point in enumerate(points):
        cell = tuple(np.floor(point / side))
        distance = np.sum((point / side - np.array(cell) - 0.5) ** 2)
        if cell not in best or distance < best[cell][0]:
            best[cell] = (distance, row)
    return sorted(row for _, row in best.values())


def test_of_a_voxel_the_point_nearest_to_its_centre_is_kept():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(2000, 3)) * [3, 2, 1]
    points[100:200] = points[:100]  # equally near: the first
    kept = nearest_to_cell_centres(points, 0.7)
    assert np.flatnonzero(kept).tolist() == brute_grid(points, 0.7)
    assert not nearest_to_cell_centres(points[:0], 0.7).any()


def test_the_voxel_filter_keeps_the_same_rows_in_every_setting(room_pair):
    """Noise moves no point into another cell, and a removed point is replaced by no other."""
    made = draws(room_pair, voxel_size=0.3)
    clean = Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0, "partial_overlap": 0.0})
    noisy = Setting.at({"sensor_noise": 0.1, "initial_pose": 2.0, "partial_overlap": 0.3})
    for scan in ("reference", "source"):
        points = getattr(room_pair, scan)
        far = np.flatnonzero(np.linalg.norm(points, axis=1) > 1.0)
        kept = np.flatnonzero(made.kept(clean, scan, 0))
        assert kept.tolist() == far[brute_grid(points[far], 0.3)].tolist()
    left = made.kept(noisy, "source", 0)
    without = draws(room_pair).kept(noisy, "source", 0)
    np.testing.assert_array_equal(left, without & made.kept(clean, "source", 0))
    np.testing.assert_array_equal(made.left(noisy, "source", 0), without)  # the causes alone
    (group, *_) = groups(room_pair, [noisy], voxel_size=0.3)
    assert len(group.reference) < 0.5 * len(room_pair.reference)


def test_points_that_the_voxel_filter_leaves_out_count_as_left_out(room_pair):
    setting = Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0, "partial_overlap": 0.2})
    estimator = Estimator.of("monte_carlo", {"voxel_size": 3.0}).of_causes(NAMES)
    with pytest.raises(PerturbationError, match="leave a run"):
        perturb.require_points(room_pair, setting, estimator, STREAMS)


def test_batches_hold_at_most_so_many_runs_and_rows(room_pair):
    levels = [0.0, 0.1, 0.2, 0.3]
    settings = [
        Setting.at({"sensor_noise": 0.0, "initial_pose": scale, "partial_overlap": level})
        for level in levels
        for scale in (1.0, 2.0)
    ]
    (group, *_) = groups(room_pair, settings)
    starts = list(group.starts)
    number = len(starts[0].T_initial)
    rows = [sum(map(len, start.rows)) for start in starts]  # shared by the two scales of a level

    def cut(runs, most):
        return [len(batch) for batch in perturb.batches(starts, runs, most)]

    assert cut(8 * number, 10**9) == [8]
    assert cut(3 * number, 10**9) == [3, 3, 2]
    assert cut(8 * number, rows[0] + rows[2]) == [4, 4]
    assert cut(8 * number, rows[0]) == [2, 2, 2, 2]
    assert cut(1, 1) == [1] * 8  # one setting at least, whatever it takes
