"""Runs that are matched together: the same bytes as alone, and the matches of brute force."""

import itertools
import tracemalloc

import numpy as np
import pytest
from test_matching import brute_force
from test_registration import PLANES, POINTS, poses, room

from icpshap import icp, se3
from icpshap.icp import accumulation
from icpshap.icp.batches import make_batch
from icpshap.icp.candidates import WORTH_SPLITTING
from icpshap.icp.keys import NEVER
from icpshap.icp.matching import measure, work_arrays
from icpshap.icp.network import LANES
from icpshap.icp.packets import LEAST, MATCHES, clusters, match_clusters, together

CHAINS = {
    "planes": PLANES,
    "points": POINTS,
    "two_matches_untrimmed": icp.Chain(matches=2, outlier_filter=icp.Trimmed(1.0)),
    "distance_limit": icp.Chain(icp.PointToPoint(), 3, maximum_distance=0.15),
    "distance_limit_untrimmed": icp.Chain(
        matches=1, outlier_filter=icp.Trimmed(1.0), maximum_distance=0.1
    ),
    "four_matches": icp.Chain(matches=4),
    "five_matches": icp.Chain(icp.PointToPoint(), 5),
}
WORK = 1000  # queries at once: so few that runs are cut into blocks


@pytest.fixture
def counted(monkeypatch):
    """The number of clusters that each iteration had."""
    numbers = []

    def counting(*arguments):
        order, ends = clusters(*arguments)
        assert sorted(order) == sorted(arguments[0])
        assert ends[-1] == len(order) and (np.diff(ends) >= LEAST).all()
        numbers.append(len(ends) - 1)
        return order, ends

    monkeypatch.setattr(accumulation, "clusters", counting)
    return numbers


def packet(points, runs, seed, share=1.0):
    """Rows of runs: those of one subsample but for few; some without 30 %, some without more."""
    rng = np.random.default_rng(seed)
    every = np.flatnonzero(rng.random(points) < share)
    rows = [every]
    for run in range(1, runs):
        kept = (1.0, 0.98, 0.7, 0.3)[run % 4]
        rows.append(every if kept == 1.0 else every[rng.random(len(every)) < kept])
    return rows


def near_poses(runs, seed, around=0.03):
    """Two starts of each run of a packet, and steps from them of several sizes."""
    starts = poses(2, seed, around)[np.arange(runs) % 2]
    scale = 10.0 ** -np.random.default_rng(seed).integers(2, 10, (runs, 1))
    return se3.exp(scale * np.random.default_rng(seed + 1).normal(size=(runs, 6))) @ starts


def registered(reference, source, rows, T_initial, chain, packets):
    """Bytes of all results of each run."""
    if not isinstance(reference, icp.Reference):
        reference = icp.Reference(reference)
    result = icp.register(reference, source, rows, T_initial, chain, packets)
    return [
        b"".join(np.ascontiguousarray(values[run]).tobytes() for values in vars(result).values())
        for run in range(len(rows))
    ]


@pytest.fixture(scope="module")
def case():
    """Reference, source, rows, starts and packets of 36 runs in three packets."""
    rows = [run for seed in range(3) for run in packet(1500, 12, seed, 0.6)]
    T_initial = np.concatenate([near_poses(12, seed) for seed in range(3)])
    return room(3000, 1), room(1500, 2), rows, T_initial, np.repeat([7, -1, 7_000_000_000], 12)


@pytest.mark.parametrize("name", CHAINS)
def test_no_byte_depends_on_the_packets(case, name, counted):
    """Against each run alone, and numbers of their own; in any order, by any numbers."""
    *pair, rows, T_initial, packets = case
    chain, runs = CHAINS[name], np.arange(len(rows))

    def results(numbers, order=runs):
        given = [rows[run] for run in order], T_initial[order], chain
        found = registered(*pair, *given, None if numbers is None else numbers[order])
        return [found[place] for place in np.argsort(order)]

    expected = results(runs)
    assert max(counted) == 0
    counted.clear()
    assert results(packets) == expected
    assert (max(counted) >= 3) == (chain.matches in MATCHES)
    for run in (0, 2, 13, 35):
        assert results(packets, np.arange(run, run + 1))[0] == expected[run]
    mixed = np.random.default_rng(0).permutation(len(rows))
    for numbers in (packets, 0 * runs, runs % 2, runs[::-1] // 5):
        assert results(numbers, mixed) == expected


def test_no_byte_depends_on_blocks_or_batches(case, counted, monkeypatch):
    *arguments, packets = case
    expected = registered(*arguments, PLANES, np.arange(len(packets)))
    monkeypatch.setattr(accumulation, "QUERIES", WORK)
    assert registered(*arguments, PLANES, packets) == expected
    assert max(counted) >= 3
    monkeypatch.setattr("icpshap.icp.registration.BATCH_BYTES", 100_000)
    assert registered(*arguments, PLANES, packets) == expected


@pytest.mark.parametrize("near", [0.0, 1.0, np.inf])
def test_no_byte_depends_on_what_counts_as_near(case, counted, monkeypatch, near):
    """Even where most queries cannot choose, and all runs of a packet follow one."""
    *arguments, packets = case
    expected = registered(*arguments, PLANES, np.arange(len(packets)))
    counted.clear()
    monkeypatch.setattr(accumulation, "NEAR", near)
    assert registered(*arguments, PLANES, packets) == expected
    assert (max(counted) > 0) == (near > 0)


def test_runs_of_one_array_object_are_a_packet(case, counted):
    reference, source, rows, T_initial, _ = case
    given = reference, source, [rows[0]] * 12, T_initial[:12], PLANES
    found = registered(*given, None)
    assert max(counted) > 0
    assert found == registered(*given, np.arange(12))


def duplicates(rng):
    return np.repeat(room(400, 1), 6, axis=0)[rng.permutation(2400)]


def coincident(rng):
    near = [3.1, 2.2, 1.3] + 1e-9 * rng.normal(size=(800, 3))
    return np.vstack([room(800, 1), near, np.tile(near[0], (400, 1))])


def far_apart(rng):
    return 0.01 * rng.normal(size=(1500, 3)) + 1000.0 * rng.integers(0, 3, (1500, 3))


CLOUDS = {
    "lattice": lambda rng: rng.integers(0, 8, (1500, 3)).astype(float),
    "duplicates": duplicates,
    "coincident": coincident,
    "far_apart": far_apart,
    "huge": lambda rng: 1e14 * rng.normal(size=(1000, 3)),
    "beyond_the_network": lambda rng: 1e17 * rng.normal(size=(1000, 3)),
    "beyond_single_precision": lambda rng: 1e22 * rng.normal(size=(1000, 3)),
    "five_points": lambda rng: rng.normal(size=(5, 3)),
    "six_points": lambda rng: rng.normal(size=(6, 3)),
}


@pytest.mark.parametrize("matches", [1, 3])
@pytest.mark.parametrize("name", CLOUDS)
def test_no_byte_depends_on_the_packets_on_hard_clouds(name, matches, counted):
    rng = np.random.default_rng(matches)
    reference = CLOUDS[name](rng)
    size = np.ptp(reference, axis=0).max()
    source = reference[rng.integers(0, len(reference), 300)]
    source[::2] += 1e-3 * size * rng.normal(size=(150, 3))
    T_initial = np.tile(np.eye(4), (16, 1, 1))
    scale = size * 10.0 ** -rng.integers(3, 12, (16, 1))
    T_initial[1:, :3, 3] = (scale * rng.normal(size=(16, 3)))[1:]
    chain = icp.Chain(icp.PointToPoint(), matches, stopping=icp.Stopping(8, 1e-9, 1e-9 * size))
    given = reference, source, packet(300, 16, 4), T_initial, chain
    expected = registered(*given, np.arange(16))
    assert registered(*given, np.zeros(16, int)) == expected
    assert max(counted) > 0


def test_runs_that_are_lost_cost_no_other_run_a_byte(case, counted):
    """Without points, with one, far outside, beyond single precision."""
    reference, source, rows, T_initial, _ = case
    rows, T_initial = rows[:12], T_initial[:12].copy()
    rows[3], rows[6] = np.array([], dtype=int), rows[0][:1]
    T_initial[[1, 2, 4], 0, 3] = 1e3, 1e30, 1e160
    T_initial[8:10] = T_initial[4]
    for chain in (PLANES, CHAINS["distance_limit_untrimmed"]):
        given = reference, source, rows, T_initial, chain
        assert registered(*given, np.zeros(12, int)) == registered(*given, np.arange(12))
        assert max(counted) > 0


def test_packets_without_points(case):
    reference, source, _, T_initial, _ = case
    rows = [np.array([], dtype=int)] * 5
    result = icp.register(icp.Reference(reference), source, rows, T_initial[:5], PLANES)
    assert set(result.status) == {"too_few_links"}
    assert (
        icp.register(icp.Reference(reference), source, [], T_initial[:0], PLANES, []).status.size
        == 0
    )


@pytest.mark.parametrize("room_left", [100, 5000, 20_000])
def test_no_byte_depends_on_the_room_for_lists(case, room_left, counted):
    reference, source, rows, T_initial, packets = case
    expected = registered(reference, source, rows, T_initial, PLANES, np.arange(len(rows)))
    little = icp.Reference(reference)
    lists = little.lists(3)
    little._lists[3] = lists._replace(records=np.empty(room_left, np.int32))
    assert registered(little, source, rows, T_initial, PLANES, packets) == expected
    assert max(counted) > 0


@pytest.mark.parametrize(
    "packets", [[0] * 2, [0] * 4, [[0] * 3], [0.0] * 3, [True] * 3, [], 0, "abc"]
)
def test_packets_that_cannot_be_used_are_refused(case, packets):
    reference, source, rows, T_initial, _ = case
    with pytest.raises(
        ValueError, match="packets: expected a whole number for each of 3 runs, got"
    ):
        icp.register(icp.Reference(reference), source, rows[:3], T_initial[:3], PLANES, packets)


def test_unlike_runs_of_one_number_take_no_more_memory():
    """Where the runs of a packet together use far more points than each of them."""
    rng = np.random.default_rng(0)
    points, runs = rng.normal(size=(50_000, 3)), 400
    positions = [
        np.sort(rng.choice(50_000, 500, replace=False)).astype(np.int32) for _ in range(runs)
    ]
    tracemalloc.start()
    batch = make_batch(points, positions, np.zeros(runs, int))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert not batch.packets.joins.any()
    assert batch.largest_block() == np.diff(batch.block_start, axis=0).sum(axis=1).max()
    assert peak < 10e6  # bytes; a mask for each run would take 20 million


def test_clusters_are_of_one_packet_and_near_their_lead():
    rng = np.random.default_rng(1)
    runs, reach = 300, 0.1
    T = se3.exp(rng.normal(scale=0.05, size=(runs, 6)))
    every = [np.arange(100, dtype=np.int32)] * runs
    number = np.sort(rng.integers(0, 3, runs))
    batch = make_batch(rng.normal(size=(100, 3)), every, number)
    active = np.flatnonzero(rng.random(runs) < 0.8)
    order, ends = clusters(active, batch.packets, T, reach)
    assert sorted(order) == list(active)
    sizes = np.diff(ends)
    assert len(sizes) >= 6 and (sizes >= LEAST).all()
    for first, last in itertools.pairwise(ends):
        members = order[first:last]
        assert (number[members] == number[members[0]]).all()
        away = T[members] - T[members[0]]
        away[:, :3, :3] *= batch.packets.spread
        assert (np.sqrt((away**2).sum(axis=(1, 2))) < reach).all()


def together_at(reference, points, T, masks, matches, limit=np.inf):
    """Squared distances, rows, keys (R, m, matches) of one cluster, and how many failed."""
    runs, lists = len(T), reference.lists(matches)
    every = np.arange(len(points), dtype=np.int32)
    batch = make_batch(points, [every[mask] for mask in masks], np.zeros(runs, int))
    assert batch.packets.joins.all()
    size = -(-len(points) // LANES) * LANES
    work, room_for_all = work_arrays(runs * size, matches), together(runs * size, runs, matches)
    begin, order = np.arange(runs) * size, np.arange(runs)
    room_for_all.failed[:] = -1
    match_clusters(
        *(lists, limit, batch, T, order, np.array([0, runs]), 0, batch.block_start.shape[0] - 1),
        *(begin, work, room_for_all),
    )
    assert list(begin) == list(np.arange(runs) * size)
    count = runs * size
    found, distance = np.empty(count * matches, np.int32), np.empty(count * matches)
    measure(lists, limit, count, work, found, distance)
    keys = (work.links[: count * matches] >> 32).reshape(runs, size, matches)[:, : len(points)]
    shape = (runs, size, matches)
    rows = np.where(found >= 0, reference.tree.rows[found], -1).reshape(shape)[:, : len(points)]
    failed = np.count_nonzero(room_for_all.failed >= 0)
    return distance.reshape(shape)[:, : len(points)], rows, keys, failed


@pytest.mark.parametrize("matches", MATCHES)
@pytest.mark.parametrize("name", ["room", *CLOUDS])
def test_runs_of_a_cluster_have_the_matches_of_brute_force(name, matches):
    """Equal squared distances to the bit; equal indices, the lowest on ties; none where unused."""
    rng = np.random.default_rng(matches)
    cloud = room(2000, 1) if name == "room" else CLOUDS[name](rng)
    if len(cloud) < matches:
        return
    reference = icp.Reference(cloud)
    centred = cloud - reference.mean
    size = np.ptp(cloud, axis=0).max()
    other = centred[rng.integers(0, len(cloud), 101)]
    points = centred[rng.integers(0, len(cloud), 101)]
    points[::3] = ((points + other) / 2)[::3]  # of a lattice: as near to several points
    points[1::3] += 1e-3 * size * rng.normal(size=points[1::3].shape)
    T = np.tile(np.eye(4), (9, 1, 1))
    T[3:, 0, 3] = size * np.array([1e-12, 1e-8, 1e-5, 1e-4, 1e-3, 1e-1])
    masks = rng.random((9, 101)) < 0.8
    masks[0] = True
    for _ in range(3):
        distance, rows, keys, failed = together_at(reference, points, T, masks, matches)
        assert name != "room" or failed < 0.2 * masks.sum()
        for run in range(9):
            own = masks[run]
            x, y, z = points.T
            moved = [
                T[run, i, 0] * x + T[run, i, 1] * y + T[run, i, 2] * z + T[run, i, 3]
                for i in range(3)
            ]
            expected, index = brute_force(centred, np.stack(moved, axis=1), matches)
            np.testing.assert_array_equal(distance[run][own], expected[own])
            np.testing.assert_array_equal(rows[run][own], index[own])
            assert (rows[run][~own] == -1).all() and (keys[run][~own] == NEVER).all()
        lists = reference.lists(matches)
        lists.records[1] = WORTH_SPLITTING - 1  # the first list is divided when it is read again


@pytest.mark.parametrize("matches", MATCHES)
def test_runs_of_a_cluster_where_single_precision_is_coarse(matches):
    """Points at nearly one distance from a query, whose coordinates are rounded by more than that.

    So the five that are next to it in single precision need not contain the nearest.
    """
    rng = np.random.default_rng(matches)
    corner = 0.3 * np.stack(np.meshgrid(*[np.arange(5.0)] * 3), axis=-1).reshape(-1, 1, 3)
    centres = np.concatenate([corner - 4e3, corner + 4e3]) + rng.uniform(0, 0.1, (250, 1, 3))
    directions = rng.normal(size=(250, 8, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    lengths = 0.05 * (1.0 + 1e-5 * rng.random((250, 8, 1)))
    cloud = (centres + lengths * directions).reshape(-1, 3)
    reference = icp.Reference(cloud)
    points = centres[:, 0] - reference.mean
    T = np.tile(np.eye(4), (4, 1, 1))
    T[1:, 0, 3] = 1e-12, 1e-7, 1e-5
    distance, rows, _, _ = together_at(reference, points, T, np.ones((4, 250), bool), matches)
    for run in range(4):
        moved = points + T[run, :3, 3]
        expected, index = brute_force(cloud - reference.mean, moved, matches)
        np.testing.assert_array_equal(distance[run], expected)
        np.testing.assert_array_equal(rows[run], index)
