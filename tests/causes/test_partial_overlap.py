"""Less overlap: the paper's rule on the raw scans, and the released code's after the noise."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from icpshap import se3
from icpshap.causes.partial_overlap import PartialOverlap
from icpshap.errors import PerturbationError
from icpshap.estimators.perturb import Streams
from icpshap.geometry import nearest_distances

STREAMS = Streams(seed=1, sequence="room", reference=0, source=1)


def kept(pair, level):
    return PartialOverlap().keep(pair, "source", level, 0, STREAMS)


@pytest.mark.parametrize("level", [0.0, 0.01, 0.05, 0.0501, 0.5])
def test_overlap_falls_by_exactly_the_share_asked_for(room_pair, level):
    removed = ~kept(room_pair, level)
    assert removed.sum() == round(level * len(room_pair.reference))
    assert not (removed & ~room_pair.overlapping).any()


def test_a_larger_level_removes_a_superset(room_pair):
    masks = [kept(room_pair, level) for level in (0.01, 0.03, 0.1)]
    for less, more in pairwise(masks):
        assert not (more & ~less).any()


def test_more_than_the_overlap_is_refused(room_pair):
    few = replace(room_pair, overlapping=np.arange(len(room_pair.source)) < 100)
    with pytest.raises(PerturbationError, match=r"Hint: partial_overlap must be at most 0\.\d+"):
        kept(few, 1.0)


def test_the_check_of_a_pair_says_so_before_anything_is_registered(room_pair):
    half = replace(room_pair, overlapping=np.arange(len(room_pair.source)) < 1500)
    PartialOverlap().check(half, 0.5)
    with pytest.raises(PerturbationError, match=r"larger than their overlap ratio 0\.\d{4}.\nHint"):
        PartialOverlap().check(half, 0.5001)


class TestSector:
    """An obstacle: all overlapping points within an azimuth sector, and no others."""

    def kept(self, pair, level, draw=0):
        cause = PartialOverlap(overlap_shape="sector")
        return cause.keep(pair, "source", level, draw, STREAMS)

    def half(self, pair):
        return replace(pair, overlapping=np.arange(len(pair.source)) % 2 == 0)

    @pytest.mark.parametrize("level", [0.0, 0.01, 0.2, 0.4501])
    def test_exactly_the_share_asked_for_goes_out_of_the_overlap(self, room_pair, level):
        pair = self.half(room_pair)
        removed = ~self.kept(pair, level)
        assert removed.sum() == round(level * len(pair.reference))
        assert not (removed & ~pair.overlapping).any()

    @pytest.mark.parametrize("draw", [0, 1, 2])
    def test_what_goes_follows_the_start_by_azimuth(self, room_pair, draw):
        pair = self.half(room_pair)
        start = STREAMS.generator(f"overlap_sector/{draw}").uniform(-np.pi, np.pi)
        azimuth = np.arctan2(pair.source[:, 1], pair.source[:, 0])
        beyond = (azimuth - start) % (2 * np.pi)
        kept = self.kept(pair, 0.2, draw)
        assert beyond[~kept].max() < beyond[kept & pair.overlapping].min()

    def test_draws_lose_sectors_of_their_own_and_a_larger_level_a_superset(self, room_pair):
        assert len({self.kept(room_pair, 0.2, draw).tobytes() for draw in range(40)}) > 2
        masks = [self.kept(room_pair, level) for level in (0.1, 0.2, 0.5)]
        for less, more in pairwise(masks):
            assert not (more & ~less).any()

    def test_a_sector_larger_than_the_overlap_is_refused(self, room_pair):
        with pytest.raises(
            PerturbationError, match=r"larger than their overlap ratio 0\.\d+.\nHint"
        ):
            PartialOverlap(overlap_shape="sector").check(self.half(room_pair), 0.6)


class TestReleasedCode:
    """`replace`: the overlap after the noise is brought to an absolute ratio."""

    def overlap(self, pair, reference, source):
        T = pair.T_reference_source
        return (nearest_distances(reference, source, T) <= 0.2).sum() / len(reference)

    def replaced(self, pair, reference, source, level):
        cause = PartialOverlap(overlap_removal="noisy")
        return cause.replace(pair, reference, source, level, STREAMS)

    def test_no_raw_row_is_masked(self, room_pair):
        cause = PartialOverlap(overlap_removal="noisy")
        assert cause.acts_when_off
        assert cause.keep(room_pair, "source", 0.3, 0, STREAMS).all()

    def test_removes_down_to_the_rounded_target(self, room_pair):
        source = self.replaced(room_pair, room_pair.reference, room_pair.source, 0.05)
        target = round(room_pair.overlap - 0.05, 2)
        reached = self.overlap(room_pair, room_pair.reference, source)
        assert reached == pytest.approx(target, abs=1 / len(room_pair.reference))

    def test_copies_reference_points_where_the_noise_left_too_few(self, room_pair):
        far = room_pair.source + np.where(np.arange(len(room_pair.source)) % 2, 30.0, 0.0)[:, None]
        source = self.replaced(room_pair, room_pair.reference, far, 0.4)
        assert len(source) > len(far)
        np.testing.assert_array_equal(source[: len(far)], far)
        copied = se3.transform(room_pair.T_reference_source, source[len(far) :])
        nearest = np.linalg.norm(copied[:, None] - room_pair.reference, axis=2).min(axis=1)
        assert nearest.max() < 0.01

    @pytest.mark.parametrize("level", [0.0, 0.004])
    def test_leaves_alone_what_is_within_a_thousandth(self, room_pair, level):
        overlapping = np.arange(len(room_pair.source)) < 0.8 * len(room_pair.reference)
        pair = replace(room_pair, overlapping=overlapping)
        assert self.replaced(pair, pair.reference, pair.source, level) is pair.source

    def test_refuses_a_target_below_zero(self, room_pair):
        with pytest.raises(PerturbationError, match="larger than the overlap ratio"):
            self.replaced(room_pair, room_pair.reference, room_pair.source, 1.5)
