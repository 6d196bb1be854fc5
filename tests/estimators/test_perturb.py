"""How the uncertainty sources act."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import kstest

from icpshap import se3
from icpshap.estimators import perturb as perturbation
from icpshap.estimators.perturb import PerturbationError, Streams

STREAMS = Streams(seed=1, sequence="room", reference=0, source=1)
DEVIATION = np.repeat([np.deg2rad(10), 0.2], 3) / np.sqrt(3)


def order_of(pair):
    return perturbation.overlap_order(pair.overlapping, STREAMS.generator("overlap"))


def test_overlap_counts_source_points_near_the_reference(room_pair):
    moved = se3.transform(room_pair.T_reference_source, room_pair.source)
    distances = np.linalg.norm(moved[:, None] - room_pair.reference[None], axis=2).min(axis=1)
    np.testing.assert_array_equal(room_pair.overlapping, distances <= 0.2)
    assert room_pair.overlap == (distances <= 0.2).sum() / len(room_pair.reference)


@pytest.mark.parametrize("reduction", [0.0, 0.01, 0.05, 0.0501, 0.5])
def test_overlap_falls_by_exactly_the_share_asked_for(room_pair, reduction):
    kept = perturbation.reduce_overlap(room_pair, reduction, order_of(room_pair))
    assert (~kept).sum() == round(reduction * len(room_pair.reference))
    assert not (~kept & ~room_pair.overlapping).any()


def test_a_larger_reduction_removes_a_superset(room_pair):
    order = order_of(room_pair)
    masks = [perturbation.reduce_overlap(room_pair, r, order) for r in (0.01, 0.03, 0.1)]
    for less, more in pairwise(masks):
        assert not (more & ~less).any()


def test_more_reduction_than_overlap_is_refused(room_pair):
    with pytest.raises(PerturbationError, match=r"Hint: partial_overlap must be at most 0\.\d+"):
        perturbation.reduce_overlap(room_pair, 1.0, order_of(room_pair)[:-1])


@pytest.mark.parametrize(
    ("scaling", "factor"), [("covariance", np.sqrt(2)), ("standard_deviation", 2)]
)
def test_initial_poses_scale_one_and_the_same_draw(room_pair, scaling, factor):
    draw = np.random.default_rng(0).standard_normal((5, 6))
    T = room_pair.T_reference_source
    xi, T_initial = perturbation.initial_poses(T, 2.0, draw, DEVIATION, scaling, "right")
    np.testing.assert_allclose(xi, factor * DEVIATION * draw)
    np.testing.assert_allclose(se3.log(se3.inverse(T) @ T_initial), xi, atol=1e-12)


def test_released_code_composes_on_the_left_with_the_inverse(room_pair):
    draw = np.random.default_rng(0).standard_normal((5, 6))
    T = room_pair.T_reference_source
    xi, T_initial = perturbation.initial_poses(
        T, 1.0, draw, DEVIATION, "covariance", "left_inverse"
    )
    np.testing.assert_allclose(se3.log(T_initial @ se3.inverse(T)), -xi, atol=1e-12)


def test_streams_differ_by_every_part_of_their_name():
    names = [
        STREAMS,
        Streams(2, "room", 0, 1),
        Streams(1, "hall", 0, 1),
        Streams(1, "room", 1, 1),
        Streams(1, "room", 0, 2),
        STREAMS.branched("again/"),
    ]
    draws = [streams.generator("noise").standard_normal() for streams in names]
    draws.append(STREAMS.generator("overlap").standard_normal())
    assert len(set(draws)) == len(draws)
    assert STREAMS.generator("noise").standard_normal() == draws[0]


def test_subsampling_keeps_rows_with_the_probability_asked_for():
    rows = [perturbation.subsample(20_000, 0.05, np.random.default_rng(seed)) for seed in range(50)]
    assert all((np.diff(kept) > 0).all() and kept[0] >= 0 and kept[-1] < 20_000 for kept in rows)
    counts = np.array([len(kept) for kept in rows])
    assert abs(counts.mean() - 1000) < 5 * np.sqrt(950 / 50)
    assert kstest(np.concatenate(rows) / 20_000, "uniform").pvalue > 1e-3


def test_subsampling_of_a_longer_cloud_begins_with_the_same_rows():
    short, long = (perturbation.subsample(n, 0.3, np.random.default_rng(4)) for n in (1000, 50_000))
    np.testing.assert_array_equal(short, long[: len(short)])


def test_probability_one_keeps_every_row():
    np.testing.assert_array_equal(
        perturbation.subsample(7, 1, np.random.default_rng(0)), np.arange(7)
    )


class TestReleasedCodesOverlap:
    """`set_overlap`: the overlap after the noise is brought to an absolute ratio."""

    def overlap(self, pair, reference, source):
        T = pair.T_reference_source
        return (perturbation.nearest_distances(reference, source, T) <= 0.2).sum() / len(reference)

    def set_overlap(self, pair, reference, source, reduction):
        generator = STREAMS.generator("overlap")
        return perturbation.set_overlap(pair, reference, source, reduction, 0.2, generator)

    def test_removes_down_to_the_rounded_target(self, room_pair):
        source = self.set_overlap(room_pair, room_pair.reference, room_pair.source, 0.05)
        target = round(room_pair.overlap - 0.05, 2)
        reached = self.overlap(room_pair, room_pair.reference, source)
        assert reached == pytest.approx(target, abs=1 / len(room_pair.reference))

    def test_copies_reference_points_where_the_noise_left_too_few(self, room_pair):
        far = room_pair.source + np.where(np.arange(len(room_pair.source)) % 2, 30.0, 0.0)[:, None]
        source = self.set_overlap(room_pair, room_pair.reference, far, 0.4)
        assert len(source) > len(far)
        np.testing.assert_array_equal(source[: len(far)], far)
        copied = se3.transform(room_pair.T_reference_source, source[len(far) :])
        nearest = np.linalg.norm(copied[:, None] - room_pair.reference, axis=2).min(axis=1)
        assert nearest.max() < 0.01

    @pytest.mark.parametrize("reduction", [0.0, 0.004])
    def test_leaves_alone_what_is_within_a_thousandth(self, room_pair, reduction):
        overlapping = np.arange(len(room_pair.source)) < 0.8 * len(room_pair.reference)
        pair = replace(room_pair, overlapping=overlapping)
        assert self.set_overlap(pair, pair.reference, pair.source, reduction) is pair.source

    def test_refuses_a_target_below_zero(self, room_pair):
        with pytest.raises(PerturbationError, match="larger than the overlap ratio"):
            self.set_overlap(room_pair, room_pair.reference, room_pair.source, 1.5)
