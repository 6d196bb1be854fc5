"""A pair of scans: its overlap, and what is said of it before it is registered."""

from dataclasses import replace

import numpy as np
import pytest

from icpshap import se3, tables
from icpshap.causes.partial_overlap import PartialOverlap
from icpshap.data.pair import Pair, Pairs, describe_pair
from icpshap.errors import DataError, PerturbationError


def described(pair, **changes):
    given = {"levels": (), "minimum_overlap": 0.1, "minimum_range": 1.0, **changes}
    return describe_pair(pair, "room", (0, 1), **given)


def test_overlap_counts_source_points_near_the_reference(room_pair):
    moved = se3.transform(room_pair.T_reference_source, room_pair.source)
    distances = np.linalg.norm(moved[:, None] - room_pair.reference[None], axis=2).min(axis=1)
    np.testing.assert_array_equal(room_pair.overlapping, distances <= 0.2)
    assert room_pair.overlap == (distances <= 0.2).sum() / len(room_pair.reference)


def test_a_description_has_the_columns_of_its_table(room_pair):
    row = described(room_pair)
    assert set(row) == {column.name for column in tables.columns("pairs")}
    assert row["registered"] and row["reason"] == row["warning"] == ""


def test_too_little_overlap_is_a_reason_and_no_error(room_pair):
    few = replace(room_pair, overlapping=np.arange(len(room_pair.source)) < 100)
    row = described(few, levels=[(PartialOverlap(), 0.9)])
    assert not row["registered"]
    assert row["reason"] == "overlap ratio 0.0333 is not above 0.1"


def test_overlap_that_the_chain_does_not_see_is_a_reason(room_pair):
    ranges = np.linalg.norm(room_pair.source, axis=1)
    near = float(np.quantile(ranges[room_pair.overlapping], 0.3))
    seen_only_near = replace(room_pair, overlapping=room_pair.overlapping & (ranges <= near))
    row = described(seen_only_near, minimum_range=near)
    assert not row["registered"]
    assert row["reason"] == f"all overlap lies within minimum_range, {near:g} m, of the scanner"


def test_a_level_that_cannot_be_applied_names_pair_and_cause(room_pair):
    expected = r"room, scans 0 and 1: partial_overlap 1 is larger than their overlap ratio.*\nHint"
    half = replace(room_pair, overlapping=np.arange(len(room_pair.source)) < 1500)
    with pytest.raises(PerturbationError, match=expected):
        described(half, levels=[(PartialOverlap(), 1)])


def test_an_overlap_ratio_above_one_is_said(room_pair):
    """The source has more points than the reference, by whose number the paper counts."""
    few = replace(room_pair, reference=room_pair.reference[::2])
    row = described(few)
    assert row["overlap"] > 1
    assert "the overlap ratio is 2.00, above 1: the source has more points" in row["warning"]


def test_how_the_true_pose_was_found_is_said_with_the_warnings(room_pair):
    doubled = np.concatenate([room_pair.source] * 2)
    row = described(room_pair, truth="the pose is registered")
    assert row["warning"] == "the pose is registered" and row["registered"]
    pair = Pair.measured(room_pair.reference, doubled, room_pair.T_reference_source, 0.2)
    row = described(pair, truth="the pose is registered")
    assert row["warning"].startswith("the pose is registered; the overlap ratio is 2.00")


def test_a_scan_of_too_few_points_is_named(room_pair):
    with pytest.raises(DataError, match=r"room, scan 0: 0 of 3000 points .*\nHint"):
        described(room_pair, minimum_range=100.0)


@pytest.fixture
def files(room_pair, tmp_path):
    """Files of the scans, the poses and the overlap of the room, with another pair behind it."""
    poses = np.stack([np.eye(4), room_pair.T_reference_source, np.eye(4)])
    tables.write(tmp_path / "poses", tables.poses_frame(poses), "poses")
    times = np.linspace(0.0, 1.0, len(room_pair.source))
    for name, index, points in (("a", 0, room_pair.reference), ("b", 1, room_pair.source)):
        more = (2, room_pair.reference[:2000], times[:2000], 0)
        scans = [(index, points, times, 0), *([more] if index else [])]
        tables.write_scans(tmp_path / name, scans, {"time": "t"})
    overlapping = room_pair.overlapping
    overlaps = [((0, 1), overlapping, 0.8), ((1, 2), overlapping[:1999], 0.8)]
    tables.write_overlaps(tmp_path / "overlaps", overlaps, {"distance": 0.2})
    return [tmp_path / "b", tmp_path / "a"], tmp_path / "poses", [tmp_path / "overlaps"]


def test_a_pair_comes_back_from_its_tables(room_pair, files):
    pairs = Pairs(*files)
    for found in (pairs.read((0, 1)), pairs.measured((0, 1), 0.2)):
        for name in ("reference", "source", "T_reference_source", "overlapping"):
            np.testing.assert_array_equal(getattr(found, name), getattr(room_pair, name))
        assert found.overlap_distance == 0.2
        np.testing.assert_array_equal(found.source_times, np.linspace(0.0, 1.0, 3000))
    with pytest.raises(DataError, match=r"overlaps: 1999 marks .* 2000 points of scan 2.\nHint"):
        pairs.read((1, 2))
    assert list(pairs.data([(0, 1)])) == ["scan_0", "scan_1"]


def test_the_characteristic_length_is_of_the_overlap_that_the_chain_sees():
    source = np.array([[0.1, 0, 0], [2, 0, 0], [4, 0, 0], [90, 0, 0]], dtype=float)
    overlapping = np.array([True, True, True, False])
    pair = Pair(source, source, np.eye(4), overlapping, 0.2).for_chain(1.0)
    assert pair.overlap_in_range.tolist() == [False, True, True, False]
    assert pair.characteristic_length == pytest.approx(1.0)
    assert np.isnan(pair.for_chain(99.0).characteristic_length)
