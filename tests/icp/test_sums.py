"""Sums in lanes and the keys that decide what enters them, against plain numpy."""

import numba
import numpy as np
import pytest

from icpshap import icp
from icpshap.icp import lanes
from icpshap.icp.keys import LARGEST, NEVER, TOGETHER, decide, known
from icpshap.icp.matching import match, measure, work_arrays
from icpshap.icp.minimisers import METRICS, plane_features, point_features


def added(metric, counts, matches, seed=0):
    """(sums of runs by `add_links`, links of each run) with about half of the links left out.

    Links: rows of x, y, z and of the reference point's row in the surface.
    """
    rng = np.random.default_rng(seed)
    surface = np.vstack([rng.normal(size=(50, 4)), np.zeros(4)])
    if metric == METRICS.index(point_features):
        surface[:-1, 3] = 1.0
    spare = sum(counts)
    points = rng.normal(size=(3, spare + 1))
    rows = rng.integers(0, 50, (spare + 1, matches)).astype(np.int32)
    rows[rng.random(rows.shape) < 0.5] = 50
    rows[spare] = 50
    starts = np.cumsum([0, *counts[:-1]])
    runs = np.arange(len(counts))[::-1].copy()
    sums = np.full((len(counts), lanes.PRODUCTS), 0.25)

    # Compiled anew, as METRICS may have been changed.
    @numba.njit
    def add(metric, x, y, z, rows, matches, surface, start, count, spare, sums, runs):
        lanes.add_links(metric, x, y, z, rows, matches, surface, start, count, spare, sums, runs)

    add(
        metric, *points, rows.ravel(), matches, surface, starts, np.array(counts), spare, sums, runs
    )
    links = [
        [
            (*points[:, query], *surface[row])
            for query in range(start, start + count)
            for row in rows[query]
            if row < 50
        ]
        for start, count in zip(starts, counts, strict=True)
    ]
    return sums[runs], links


@pytest.mark.parametrize("matches", [1, 3])
@pytest.mark.parametrize("features", METRICS)
def test_every_lane_sums_the_products_of_its_own_kept_links(features, matches):
    counts = [7, 0, 40, 1, 12, 12, 3, 25]
    sums, links = added(METRICS.index(features), counts, matches)
    for total, of_run in zip(sums, links, strict=True):
        rows = np.array([features(*link) for link in of_run]).reshape(-1, 7)
        gram = lanes.gram_matrices(total[None] - 0.25)[0]
        np.testing.assert_allclose(gram, rows.T @ rows, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("features", METRICS)
def test_a_row_of_zeros_adds_nothing(features):
    assert features(1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0) == (0.0,) * 7


def test_a_metric_of_ones_own_is_a_function(monkeypatch):
    """As docs/engine.md says: point to plane with the weight of a link in its normal's length."""

    def weighted(x, y, z, a, b, c, d):
        return tuple(feature + feature for feature in plane_features(x, y, z, a, b, c, d))

    monkeypatch.setattr(lanes, "METRICS", (*METRICS, weighted))
    plain, _ = added(METRICS.index(plane_features), [9, 4] * 4, 3)
    doubled, _ = added(len(METRICS), [9, 4] * 4, 3)
    np.testing.assert_allclose(doubled - 0.25, 4.0 * (plain - 0.25), rtol=1e-13)


def test_features_are_those_of_the_textbook():
    p, q, n = np.random.default_rng(1).normal(size=(3, 3))
    plane = plane_features(*p, *n, n @ q)
    np.testing.assert_allclose(plane, [*np.cross(p, n), *n, n @ (q - p)], rtol=1e-13)
    np.testing.assert_allclose(point_features(*p, *q, 1.0), [*p, *(p - q), 1.0])


@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e4])
@pytest.mark.parametrize("room", [None, 0], ids=["lists", "tree"])
def test_keys_are_never_wrong_about_a_bound(scale, room):
    """Whichever way a link was found: by the network, or by full distances."""
    rng = np.random.default_rng(1)
    reference = icp.Reference(scale * rng.normal(size=(3000, 3)))
    lists = reference.lists(3)
    if room is not None:
        lists = lists._replace(records=np.empty(room, np.int32))
    count = 4000
    work = work_arrays(count, 3)
    points = reference.tree.points[rng.integers(0, 3000, count), :3]
    away = scale * rng.choice([1e-5, 1e-3, 0.2], (count, 1))
    queries = points + away * rng.normal(size=(count, 3))
    work.x[:count], work.y[:count], work.z[:count] = queries.T
    found, distance = np.empty(3 * count, np.int32), np.empty(3 * count)
    match(lists, np.inf, count, work)
    measure(lists, np.inf, count, work, found, distance)
    keys = work.links[: 3 * count] >> 32
    unsure = []
    for bound in (*np.quantile(distance, [0.0, 0.1, 0.5, 0.7, 1.0]), 0.0, 1e-30):
        below, beyond = known(bound, lists.largest)
        assert (distance[keys < below] < bound).all()
        assert (distance[keys >= beyond] >= bound).all()
        unsure.append(np.mean((keys >= below) & (keys < beyond)))
    assert max(unsure[2:4]) < 1e-2


def test_keys_of_no_bound_and_of_bounds_beyond_single_precision():
    largest_key = np.float32(LARGEST).view(np.int32)
    assert known(np.inf, 1.0) == (NEVER, NEVER)
    below, beyond = known(-np.inf, 1.0)
    assert below == 0 and 0 < beyond < 1_000_000_000
    assert known(1e60, 1e25)[0] <= largest_key < known(1e60, 1e25)[1]


def test_links_of_the_next_run_are_not_counted():
    @numba.njit
    def decided(links, last, rows):
        return decide(links, 0, last, *bounds, np.int32(99), rows)

    keys = np.arange(2 * TOGETHER)
    bounds = tuple(np.int32(k) for k in (5, 9, NEVER, NEVER))
    rows = np.empty(2 * TOGETHER, np.int32)
    for last in (1, 7, TOGETHER, 2 * TOGETHER):
        sure, made, unsure = decided(keys << 32 | keys + 40, last, rows)
        inside = min(last, TOGETHER)
        assert (sure, made) == (min(inside, 5), inside)
        assert unsure == ((1 << min(inside, 9)) - 1) & ~0b11111
        assert list(rows[:TOGETHER]) == [k + 40 if k < 5 else 99 for k in range(TOGETHER)]
