"""The weakest direction loses the share of its information that was asked for, in both scans."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from icpshap import se3
from icpshap.causes.under_constrained import UnderConstrained
from icpshap.data.pair import Pair
from icpshap.errors import PerturbationError
from icpshap.explanation import readings

MINIMUM_RANGE = 1.0


def kept(pair, scan, level):
    return UnderConstrained().keep(pair, scan, level, 0, None)


@pytest.fixture(scope="module")
def corridor():
    """Walls, floor and ceiling along x, and at both ends a wall of few points; points nearby.

    Normals are known: y, z and x. Only the end walls hold the translation along x.
    """
    generator = np.random.default_rng(4)

    def cloud(wall=2000, end=150):
        sides = generator.uniform(-1, 1, (2 * wall, 3)) * [3, 0, 1.2]
        sides[:, 1] = np.where(np.arange(2 * wall) % 2, 1.5, -1.5)
        levels = generator.uniform(-1, 1, (2 * wall, 3)) * [3, 1.4, 0]
        levels[:, 2] = np.where(np.arange(2 * wall) % 2, 1.4, -1.4)
        ends = generator.uniform(-1, 1, (2 * end, 3)) * [0, 1.2, 1.1]
        ends[:, 0] = np.where(np.arange(2 * end) % 2, 3.5, -3.5)
        robot = generator.uniform(-0.3, 0.3, (200, 3))
        return np.vstack([sides, levels, ends, robot])

    T_reference_source = se3.exp([0.0, 0.0, 0.1, 0.1, 0.05, 0.0])
    source = se3.transform(se3.inverse(T_reference_source), cloud())
    pair = Pair.measured(cloud(), source, T_reference_source, 0.4)
    return pair.for_chain(MINIMUM_RANGE)


def on_an_end_wall(points):
    return np.abs(np.abs(points[:, 0]) - 3.5) < 0.05


def test_the_end_walls_go_and_nothing_else(corridor):
    source = se3.transform(corridor.T_reference_source, corridor.source)
    for scan, points in (("source", source), ("reference", corridor.reference)):
        gone = ~kept(corridor, scan, 0.8)
        assert on_an_end_wall(points)[gone].mean() > 0.95
        assert gone.sum() == pytest.approx(0.8 * on_an_end_wall(points).sum(), rel=0.1)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_f_follows_the_law_of_one_direction(corridor, share):
    """f = (-ln(1 - u) - u) / 2, where a covariance is the inverse of its information on x."""
    inside = corridor.overlapping & (np.linalg.norm(corridor.source, axis=1) > MINIMUM_RANGE)
    source = se3.transform(corridor.T_reference_source, corridor.source)
    # Of the points of the end walls each has the information 1 on x, and no other point has any.
    before = (inside & on_an_end_wall(source)).sum()
    after = (inside & on_an_end_wall(source) & kept(corridor, "source", share)).sum()
    clean, perturbed = np.eye(6), np.eye(6)
    perturbed[3, 3] = before / after
    law = (-np.log(1 - share) - share) / 2
    one_point = 1.5 / after / 2
    assert readings.kullback_leibler(clean, perturbed) == pytest.approx(law, abs=one_point)


def test_masks_grow_with_u_and_do_not_know_the_draw(corridor):
    for scan in ("reference", "source"):
        masks = [kept(corridor, scan, level) for level in (0.0, 0.3, 0.6, 0.95)]
        assert masks[0].all()
        for less, more in pairwise(masks):
            assert not (more & ~less).any() and more.sum() < less.sum()


def test_near_points_and_source_points_that_do_not_overlap_stay(corridor):
    pair = replace(corridor, overlapping=corridor.overlapping & (np.arange(8500) % 2 == 0))
    near = np.linalg.norm(pair.source, axis=1) <= MINIMUM_RANGE
    assert kept(pair, "source", 0.99)[near | ~pair.overlapping].all()
    near = np.linalg.norm(pair.reference, axis=1) <= MINIMUM_RANGE
    assert kept(pair, "reference", 0.99)[near].all()


def test_a_turned_world_loses_the_same_points(corridor):
    """The direction is one of the geometry, not of a frame's axes."""
    turn = se3.exp([0.3, -0.2, 0.5, 0.0, 0.0, 0.0])
    turned = replace(
        corridor,
        reference=se3.transform(turn, corridor.reference),
        T_reference_source=turn @ corridor.T_reference_source,
    )
    one, other = (kept(pair, "source", 0.8) for pair in (corridor, turned))
    assert (one != other).mean() < 0.005


def test_a_pair_without_overlap_beyond_the_minimum_range_is_refused(corridor):
    UnderConstrained().check(corridor, 0.5)
    far = corridor.for_chain(50.0)
    with pytest.raises(PerturbationError, match=r"minimum_range: 50 m, expected some.\nHint"):
        UnderConstrained().check(far, 0.5)
