"""Matches against brute force: distances, indices, ties; everywhere and for 1 to 5 matches."""

import numba
import numpy as np
import pytest
from conftest import folder_in

from icpshap import icp
from icpshap.data.scans import read_scan
from icpshap.icp.candidates import HEADER, LEVELS, WORTH_SPLITTING
from icpshap.icp.matching import match, measure, work_arrays
from icpshap.icp.nearest import QUERIES
from icpshap.icp.network import LANES, PLACE, nearest_three

GENERATORS = {
    "random": lambda rng: rng.normal(size=(2000, 3)),
    "duplicates": lambda rng: np.repeat(rng.normal(size=(60, 3)), 9, axis=0)[rng.permutation(540)],
    "many_duplicates": lambda rng: np.repeat(rng.normal(size=(4, 3)), 300, axis=0),
    "collinear": lambda rng: rng.normal(size=(800, 1)) * [1.0, 2.0, -1.0] + [3.0, 0, 0],
    "lattice": lambda rng: rng.integers(0, 8, (1500, 3)).astype(float),
    "dense_near_the_scanner": lambda rng: (
        rng.normal(size=(3000, 3)) * 10 ** rng.uniform(-3, 1, (3000, 1))
    ),
    "outlier": lambda rng: np.vstack([rng.normal(size=(1000, 3)), [[1e5, -1e5, 3.0]]]),
    "villages_kilometres_apart": lambda rng: (
        0.01 * rng.normal(size=(1500, 3)) + 1000.0 * rng.integers(0, 3, (1500, 3))
    ),
    "huge": lambda rng: 1e17 * rng.normal(size=(800, 3)),
    "tiny": lambda rng: 1e-12 * rng.normal(size=(800, 3)),
    "five_points": lambda rng: rng.normal(size=(5, 3)),
}


def queries_for(reference, rng):
    """Points of the cloud, near it, between them, in empty space and far outside."""
    chosen = reference[rng.integers(0, len(reference), 400)]
    other = reference[rng.integers(0, len(reference), 400)]
    size = np.ptp(reference[:-1], axis=0).max()
    return np.vstack(
        [
            chosen,
            chosen + rng.normal(scale=0.01 * size, size=chosen.shape),
            (chosen + other) / 2,
            rng.uniform(-1, 1, (100, 3)) * size,
            rng.uniform(-100, 100, (100, 3)) * size,
        ]
    )


def divide_soon(lists):
    """As if so much had been scanned in every cube that the next query divides it."""
    record = 0
    while record < lists.used[1]:
        lists.records[record + 1] = WORTH_SPLITTING - 1
        record += HEADER + lists.records[record]


def engine_matches(reference, queries, matches, limit=np.inf, room=None):
    """(squared distances, original indices), each (n, matches), by the engine.

    room: integers that the lists may take.
    """
    reference = icp.Reference(reference)
    tree, lists = reference.tree, reference.lists(matches)
    if room is not None:
        lists = lists._replace(records=np.empty(room, dtype=np.int32))
    queries = queries - reference.mean
    count = len(queries)
    work = work_arrays(count, matches)
    work.x[:count], work.y[:count], work.z[:count] = queries.T
    found = np.empty(count * matches, dtype=np.int32)
    distance = np.empty(count * matches)
    for _ in range(LEVELS):
        match(lists, limit, count, work)
        measure(lists, limit, count, work, found, distance)
        divide_soon(lists)
    index = np.where(found >= 0, tree.rows[found], -1)
    return distance.reshape(-1, matches), index.reshape(-1, matches), queries, reference


def brute_force(reference, queries, matches):
    """The same by sorting all points by (squared distance, index)."""
    difference = reference[None] - queries[:, None]
    x, y, z = np.moveaxis(difference, -1, 0)
    squared = x * x + y * y + z * z
    index = np.argsort(squared, axis=1, kind="stable")[:, :matches]
    return np.take_along_axis(squared, index, axis=1), index


@pytest.mark.parametrize("matches", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("name", GENERATORS)
def test_same_matches_as_brute_force(name, matches):
    """Equal squared distances to the bit; equal indices, the lowest on ties."""
    rng = np.random.default_rng(matches)
    cloud = GENERATORS[name](rng)
    distance, index, queries, reference = engine_matches(cloud, queries_for(cloud, rng), matches)
    expected_distance, expected_index = brute_force(cloud - reference.mean, queries, matches)
    np.testing.assert_array_equal(distance, expected_distance)
    np.testing.assert_array_equal(index, expected_index)


@pytest.mark.parametrize("matches", [1, 2, 3, 4, 5])
def test_same_matches_as_brute_force_on_real_scans(matches):
    folder = folder_in("ICPSHAP_REAL_DATA") / "apartment_pair" / "csv_local"
    cloud, source = (read_scan(folder / f"Hokuyo_{k}.csv")[0] for k in (0, 1))
    rng = np.random.default_rng(matches)
    queries = np.vstack([source[rng.permutation(len(source))[:200]], queries_for(cloud, rng)[::40]])
    distance, index, queries, reference = engine_matches(cloud, queries, matches)
    expected_distance, expected_index = brute_force(cloud - reference.mean, queries, matches)
    np.testing.assert_array_equal(distance, expected_distance)
    np.testing.assert_array_equal(index, expected_index)


def test_links_longer_than_the_limit_are_dropped():
    rng = np.random.default_rng(0)
    cloud = GENERATORS["random"](rng)
    points = queries_for(cloud, rng)
    limited, index, queries, reference = engine_matches(cloud, points, 3, limit=0.01)
    distance, expected = brute_force(cloud - reference.mean, queries, 3)
    near = distance <= 0.01
    assert 0 < near.sum() < near.size
    np.testing.assert_array_equal(index, np.where(near, expected, -1))
    np.testing.assert_array_equal(limited, np.where(near, distance, np.inf))


def test_a_matcher_gives_the_same_in_parts_of_any_size():
    """Rows of the cloud as it was given, for more points than are matched together."""
    rng = np.random.default_rng(3)
    cloud = GENERATORS["random"](rng)
    points = np.repeat(queries_for(cloud, rng), 30, axis=0)
    reference = icp.Reference(cloud)
    matcher = icp.Matcher(reference, 3)
    distance, rows = matcher(points)
    assert len(points) > QUERIES
    expected, index = brute_force(cloud - reference.mean, points[::30] - reference.mean, 3)
    np.testing.assert_array_equal(distance[::30], expected)
    np.testing.assert_array_equal(rows, np.repeat(index, 30, axis=0))
    limited, rows = matcher(points, limit=0.01)
    near = distance <= 0.01
    assert 0 < near.sum() < near.size
    np.testing.assert_array_equal(rows, np.where(near, np.repeat(index, 30, axis=0), -1))
    np.testing.assert_array_equal(limited, np.where(near, distance, np.inf))
    with pytest.raises(ValueError, match="4 matches a point need as many reference points"):
        icp.Matcher(icp.Reference(cloud[:3]), 4)(points)


def test_normals_in_the_order_of_the_points():
    rng = np.random.default_rng(3)
    reference = icp.Reference(GENERATORS["random"](rng))
    np.testing.assert_array_equal(
        reference.in_rows(reference.normals)[reference.tree.rows], reference.normals
    )


def test_nearly_equal_distances_are_told_apart():
    """Squared distances that differ in the last bits only, where the lists' keys cannot tell."""
    rng = np.random.default_rng(5)
    directions = rng.normal(size=(400, 3))
    cloud = directions / np.linalg.norm(directions, axis=1)[:, None]
    centre = np.vstack([np.zeros(3), rng.normal(scale=1e-15, size=(20, 3))])
    distance, index, queries, reference = engine_matches(cloud, centre, 3)
    expected_distance, expected_index = brute_force(cloud - reference.mean, queries, 3)
    assert np.ptp(expected_distance) < 1e-14
    np.testing.assert_array_equal(distance, expected_distance)
    np.testing.assert_array_equal(index, expected_index)


def test_lists_are_divided_down_to_the_finest_cubes():
    rng = np.random.default_rng(4)
    cloud = np.vstack([rng.normal(size=(3000, 3)), 1e-4 * rng.normal(size=(1000, 3))])
    points = cloud[-1000:] + 1e-5 * rng.normal(size=(1000, 3))
    distance, index, queries, reference = engine_matches(cloud, points, 3)
    expected_distance, expected_index = brute_force(cloud - reference.mean, queries, 3)
    np.testing.assert_array_equal(distance, expected_distance)
    np.testing.assert_array_equal(index, expected_index)
    lists = reference.lists(3)
    cells, sizes = np.arange(np.prod(lists.shape)), 1
    while len(children := lists.cells[cells][lists.cells[cells] > 0]):
        cells, sizes = (children[:, None] + np.arange(8)).ravel(), sizes + 1
    assert sizes == LEVELS


@pytest.mark.parametrize("room", [100, 5000, 20_000, 100_000])
def test_full_lists_change_no_match(room):
    rng = np.random.default_rng(2)
    cloud = GENERATORS["dense_near_the_scanner"](rng)
    points = queries_for(cloud, rng)
    distance, index, _, _ = engine_matches(cloud, points, 3, room=room)
    expected_distance, expected_index, _, _ = engine_matches(cloud, points, 3)
    np.testing.assert_array_equal(distance, expected_distance)
    np.testing.assert_array_equal(index, expected_index)


@numba.njit
def network(coarse, records, queries, largest, key):
    return nearest_three(coarse, records, 0, len(records), queries, 0, largest, key)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_network_decides_nearly_all_queries_and_never_wrongly(scale):
    """Random candidates; then such as differ by less than single precision can tell."""
    rng = np.random.default_rng(3)
    points = np.zeros((250, 4))
    queries = np.zeros((LANES, 4))
    key = np.zeros(4 * LANES, dtype=np.int32)
    records = np.arange(250, dtype=np.int32)
    decided = []
    for closeness in np.repeat([1.0, 1e-3, 1e-5, 1e-7, 0.0], 40):
        directions = rng.normal(size=(250, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        queries[:, :3] = scale * rng.uniform(-1, 1, 3)
        distances = scale * (1.0 + closeness * rng.uniform(-0.9, 0.9, 250))
        points[:, :3] = queries[0, :3] + directions * distances[:, None]
        coarse, single = points.astype(np.float32), queries.astype(np.float32)
        undecided, unordered = network(coarse, records, single, 3.0 * scale, key)
        x, y, z, _ = (points - queries[0]).T
        expected = np.argsort(x * x + y * y + z * z, kind="stable")[:3]
        for lane in range(LANES):
            found = key[lane : 3 * LANES : LANES] & PLACE
            if not undecided >> lane & 1:
                np.testing.assert_array_equal(np.sort(found), np.sort(expected))
                if not unordered >> lane & 1:
                    np.testing.assert_array_equal(found, expected)
        decided.append(undecided == 0 and unordered == 0)
    assert np.mean(decided[:40]) > 0.9
    assert not np.any(decided[-80:])
