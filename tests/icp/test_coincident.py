"""Clouds with many points at one place, or nearly: the same matches, honest statuses, linear time.

Work is counted where it can be: compiled functions are run as plain Python with counting arrays.
"""

import time

import numpy as np
import pytest
from test_matching import brute_force, engine_matches, queries_for
from test_registration import poses, room

from icpshap import icp
from icpshap.icp import candidates, kdtree
from icpshap.icp.matching import match, measure, work_arrays
from icpshap.icp.selection import select

PLACE = np.array([3.1, 2.2, 1.3])
ULP = np.spacing(PLACE[0])
PLANES = icp.Chain(stopping=icp.Stopping(20))
POINTS = icp.Chain(icp.PointToPoint(), 1, icp.Trimmed(0.75), stopping=icp.Stopping(20))
CHAINS = pytest.mark.parametrize("chain", [PLANES, POINTS], ids=["planes", "points"])


def one_place(n, rng):
    return np.tile(PLACE, (n, 1))


def few_places(n, rng, places=10):
    return rng.uniform(-2, 2, (places, 3))[rng.integers(0, places, n)]


def half_at_one_place(n, rng):
    return np.vstack([room(n // 2, 1), one_place(n - n // 2, rng)])[rng.permutation(n)]


def every_point_twice(n, rng):
    return np.repeat(room(n // 2, 1), 2, axis=0)[rng.permutation(n // 2 * 2)]


def one_ulp_apart(n, rng):
    return PLACE + ULP * rng.integers(0, 2, (n, 3))


def a_line_of_ulps(n, rng):
    return PLACE + ULP * rng.permutation(n)[:, None] * [1.0, 0.0, 0.0]


def half_within_some_ulps(n, rng):
    near = PLACE + ULP * rng.integers(0, 30, (n - n // 2, 3))
    return np.vstack([room(n // 2, 1), near])[rng.permutation(n)]


def half_within_a_nanometre(n, rng):
    near = PLACE + 1e-9 * rng.normal(size=(n - n // 2, 3))
    return np.vstack([room(n // 2, 1), near])[rng.permutation(n)]


def a_line(n, rng):
    return np.linspace(-1, 1, n)[:, None] * [1.0, 2.0, -1.0]


def a_line_there_and_back(n, rng):
    rising = np.arange(n)
    return np.minimum(rising, n - 1 - rising)[:, None] / n * [1.0, 2.0, -1.0]


def a_grid_on_a_plane(n, rng):
    side = np.arange(int(np.sqrt(n))) / 32.0
    return np.stack(np.meshgrid(side, side, [0.5]), axis=-1).reshape(-1, 3)


CLOUDS = [
    one_place,
    few_places,
    half_at_one_place,
    every_point_twice,
    one_ulp_apart,
    a_line_of_ulps,
    half_within_some_ulps,
    half_within_a_nanometre,
    a_line,
    a_line_there_and_back,
    a_grid_on_a_plane,
]


@pytest.mark.parametrize("matches", [1, 3, 5])
@pytest.mark.parametrize("cloud", CLOUDS)
def test_same_matches_as_brute_force(cloud, matches):
    """Equal squared distances to the bit; equal indices, the lowest on ties."""
    rng = np.random.default_rng(matches)
    points = cloud(1500, rng)
    distance, index, queries, reference = engine_matches(points, queries_for(points, rng), matches)
    expected_distance, expected_index = brute_force(points - reference.mean, queries, matches)
    np.testing.assert_array_equal(distance, expected_distance)
    np.testing.assert_array_equal(index, expected_index)


@pytest.mark.parametrize("cloud", CLOUDS)
def test_the_tree_alone_finds_the_same(cloud):
    """More neighbours than a leaf holds, as normals may ask for."""
    rng = np.random.default_rng(0)
    points = cloud(1000, rng)
    tree, queries = kdtree.build(points), queries_for(points, rng)[::7]
    found, distance = np.empty(30, np.int32), np.empty(30)
    stack = np.empty(kdtree.STACK, np.int32)
    expected_distance, expected_index = brute_force(points, queries, 30)
    for query, d2, index in zip(queries, expected_distance, expected_index, strict=True):
        kdtree.nearest(tree, *query, np.inf, found, distance, stack)
        np.testing.assert_array_equal(distance, d2)
        np.testing.assert_array_equal(tree.rows[found], index)


@pytest.mark.parametrize("cloud", [one_place, few_places, one_ulp_apart, half_within_some_ulps])
def test_a_search_visits_few_boxes_however_many_points_are_equal(cloud, monkeypatch):
    visited = []
    plain = kdtree.box_distance.py_func
    monkeypatch.setattr(kdtree, "box_distance", lambda *of: visited.append(0) or plain(*of))
    stack, found, distance = np.empty(kdtree.STACK, np.int32), np.empty(7, np.int32), np.empty(7)
    rng = np.random.default_rng(0)
    for n in (2000, 32_000):
        points = cloud(n, rng)
        tree = kdtree.build(points)
        for query in (points[0], PLACE, PLACE + 0.01, PLACE - 100.0):
            visited.clear()
            kdtree.nearest.py_func(tree, *query, np.inf, found, distance, stack)
            assert len(visited) < 500  # of 512 and 8,192


class Counting:
    """An array that counts how often it is read."""

    def __init__(self, values):
        self.values, self.read = list(values), 0

    def __getitem__(self, place):
        self.read += 1
        return self.values[place]

    def __setitem__(self, place, value):
        self.values[place] = value


@pytest.mark.parametrize("turned", [1.0, -1.0], ids=["rising_first", "falling_first"])
def test_selection_is_linear_in_values_that_come_there_and_back(turned):
    n = 20_000
    points = turned * a_line_there_and_back(n, None)
    values, order = Counting(points[:, 0]), list(range(n))
    assert select.py_func(values, n, n // 2, order) == np.sort(points[:, 0])[n // 2]
    low, high = points[order[: n // 2], 0], points[order[n // 2 :], 0]
    assert low.max() <= high.min()
    assert values.read < 200 * n


def budget(lists, points):
    return candidates.BUDGET_POINT * points + candidates.BUDGET_QUERY * lists.used[3]


def queries_around(place, count, rng):
    return place + 10 ** rng.uniform(-9, 0, (count, 1)) * rng.normal(size=(count, 3))


@pytest.mark.parametrize("left", [np.inf, 200_000, -1], ids=["whole", "little", "none"])
def test_the_budget_of_fills_is_kept_and_changes_no_match(left):
    rng = np.random.default_rng(1)
    points = half_within_a_nanometre(2000, rng)
    reference = icp.Reference(points)
    lists, count = reference.lists(3), 2000
    if left < np.inf:
        lists.used[2] = budget(lists, len(points)) + candidates.BUDGET_QUERY * count - left
    before = lists.used[2]
    queries = queries_around(PLACE, count, rng) - reference.mean
    work = work_arrays(count, 3)
    work.x[:count], work.y[:count], work.z[:count] = queries.T
    found, distance = np.empty(3 * count, np.int32), np.empty(3 * count)
    match(lists, np.inf, count, work)
    measure(lists, np.inf, count, work, found, distance)
    d2, index = brute_force(points - reference.mean, queries, 3)
    np.testing.assert_array_equal(distance.reshape(-1, 3), d2)
    np.testing.assert_array_equal(reference.tree.rows[found].reshape(-1, 3), index)
    assert lists.used[2] <= budget(lists, len(points)) + len(points)
    assert (lists.used[2] == before) == (left < 0)


def test_only_the_first_of_coincident_points_enter_a_list():
    rng = np.random.default_rng(2)
    points = few_places(40_000, rng)
    _, _, _, reference = engine_matches(points, queries_around(points[0], 300, rng), 3)
    assert reference.lists(3).records[0] < 10 * 30


@pytest.mark.parametrize("sources", [1, 2])
@pytest.mark.parametrize("references", [1, 2, None])
@CHAINS
@pytest.mark.parametrize("n", [50, 20_000])
def test_one_or_two_places_determine_no_pose(n, chain, references, sources):
    """Whether the source, the reference or both are degenerate; with however much rounding."""
    rng = np.random.default_rng(3)
    source = few_places(n, rng, sources)
    reference = room(3000, 1) if references is None else few_places(n, rng, references)
    T_initial = poses(2, 4)
    rows = [np.arange(n), np.arange(n // 2)]
    for pair in ((reference, source), (source, reference)):
        runs = rows if pair[1] is source else [np.arange(len(reference))] * 2
        result = icp.register(icp.Reference(pair[0]), pair[1], runs, T_initial, chain)
        assert set(result.status) == {"degenerate"}
        np.testing.assert_allclose(result.T_reference_source, T_initial, atol=1e-12)


def test_distinct_places_still_determine_a_pose():
    rng = np.random.default_rng(6)
    points = few_places(30_000, rng)
    result = icp.register(
        icp.Reference(points), points, [np.arange(len(points))], poses(1, 4), POINTS
    )
    assert list(result.status) == ["ok"]
    np.testing.assert_allclose(result.T_reference_source[0], np.eye(4), atol=1e-9)


@CHAINS
@pytest.mark.parametrize("cloud", CLOUDS)
def test_time_grows_like_the_number_of_points(cloud, chain):
    """Four times the points in less than eight times the time, where the square would be sixteen.

    Beside a tenth of a second, which is what other processes may take from us.
    """
    T_initial = poses(2, 4)

    def seconds(n):
        rng = np.random.default_rng(0)
        reference, source = cloud(n, rng), cloud(n, rng)
        taken = []
        for _ in range(3):
            start = time.process_time()
            rows = [np.arange(len(source))] * 2
            result = icp.register(icp.Reference(reference), source, rows, T_initial, chain)
            taken.append(time.process_time() - start)
            assert np.isfinite(result.T_reference_source).all()
        return min(taken)

    seconds(100)  # compiled, or read from the cache
    few = seconds(5000)
    assert seconds(20_000) < 8 * few + 0.1
