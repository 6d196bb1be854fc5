"""The ICP engine against a plain implementation, against itself, and at the edges."""

import logging
import tracemalloc

import numba
import numpy as np
import plain_icp
import pytest
import threadpoolctl

from icpshap import icp, se3
from icpshap.icp.circles import Circles
from icpshap.icp.order import spatial

PLANES = icp.Chain()
POINTS = icp.Chain(icp.PointToPoint(), matches=1, outlier_filter=icp.Trimmed(0.75))


def room(points, seed, noise=0.01):
    """Points (n, 3) on the walls of a room with a box in it."""
    rng = np.random.default_rng(seed)
    half = np.where(rng.random(points)[:, None] < 0.7, [4.0, 3.0, 1.2], [0.6, 0.4, 0.8])
    cloud = rng.uniform(-1, 1, (points, 3))
    axis = rng.integers(0, 3, points)
    cloud[np.arange(points), axis] = rng.choice([-1.0, 1.0], points)
    return cloud * half + rng.normal(scale=noise, size=(points, 3))


def poses(runs, seed, scale=0.05):
    return se3.exp(np.random.default_rng(seed).normal(scale=scale, size=(runs, 6)))


def subsets(runs, points, share, seed):
    rng = np.random.default_rng(seed)
    return [np.flatnonzero(rng.random(points) < share) for _ in range(runs)]


@pytest.fixture(scope="module")
def pair():
    return room(6000, 1), room(6000, 2)


@pytest.mark.parametrize(
    ("chain", "options"),
    [
        (PLANES, {}),
        (POINTS, {"planes": False, "matches": 1, "ratio": 0.75}),
        (
            icp.Chain(icp.PointToPoint(), 5, icp.Trimmed(1.0), maximum_distance=0.3),
            {"planes": False, "matches": 5, "ratio": 1.0, "maximum_distance": 0.3},
        ),
        (
            icp.Chain(matches=2, maximum_distance=0.2, stopping=icp.Stopping(7, 1e-9, 1e-9)),
            {"matches": 2, "maximum_distance": 0.2, "maximum_iterations": 7, "rotation": 1e-9},
        ),
    ],
    ids=["paper", "point_to_point", "untrimmed", "distance_limit"],
)
def test_agrees_with_plain_icp_run_by_run(pair, chain, options):
    reference, source = pair
    rows, T_initial = subsets(6, len(source), 0.7, 3), poses(6, 4)
    result = icp.register(icp.Reference(reference), source, rows, T_initial, chain)
    for run in range(6):
        T, iterations, rmse, inliers = plain_icp.register(
            reference, source[rows[run]], T_initial[run], **options
        )
        np.testing.assert_allclose(result.T_reference_source[run], T, atol=1e-9)
        assert result.iterations[run] == iterations
        np.testing.assert_allclose(result.rmse[run], rmse, rtol=1e-9)
        np.testing.assert_allclose(result.inlier_ratio[run], inliers, rtol=1e-12)


def test_finds_the_pose_of_a_moved_copy(pair):
    reference, _ = pair
    T = poses(1, 9)[0]
    source = se3.transform(se3.inverse(T), reference)
    everything = [np.arange(len(source))]
    result = icp.register(
        icp.Reference(reference), source, everything, (T @ poses(1, 5, 0.01)[0])[None], POINTS
    )
    assert result.status[0] == "ok"
    np.testing.assert_allclose(result.T_reference_source[0], T, atol=1e-9)
    assert result.rmse[0] < 1e-9


@pytest.mark.parametrize("chain", [PLANES, POINTS], ids=["planes", "points"])
def test_a_run_does_not_depend_on_the_others(pair, chain, monkeypatch):
    """Order, company, history of the lists and the size of batches change no byte."""
    reference, source = pair
    rows, T_initial = subsets(12, len(source), 0.9, 6), poses(12, 7)

    def register(runs, shared=None):
        shared = shared or icp.Reference(reference)
        part = icp.register(shared, source, [rows[r] for r in runs], T_initial[runs], chain)
        return part.T_reference_source, part.rmse

    shared = icp.Reference(reference)
    together = register(np.arange(12), shared)
    assert len(np.unique(together[0], axis=0)) == 12
    backwards = register(np.arange(12)[::-1], shared)
    alone = [register(np.array([run])) for run in (0, 5, 11)]
    monkeypatch.setattr("icpshap.icp.registration.BATCH_BYTES", 150_000)
    in_small_batches = register(np.arange(12))
    for k in range(2):
        assert together[k].tobytes() == backwards[k][::-1].tobytes()
        assert together[k].tobytes() == in_small_batches[k].tobytes()
        for run, result in zip((0, 5, 11), alone, strict=True):
            assert together[k][run].tobytes() == result[k][0].tobytes()


@pytest.mark.parametrize("chain", [PLANES, POINTS], ids=["planes", "points"])
def test_the_number_of_threads_changes_no_byte(pair, chain):
    reference, source = pair
    arguments = (source, subsets(12, len(source), 0.9, 6), poses(12, 7), chain)
    found = set()
    threads_before = numba.get_num_threads()
    for threads in (1, 2):
        numba.set_num_threads(min(threads, threads_before))
        with threadpoolctl.threadpool_limits(threads):
            found.add(
                icp.register(icp.Reference(reference), *arguments).T_reference_source.tobytes()
            )
    numba.set_num_threads(threads_before)
    assert len(found) == 1


def test_runs_may_share_their_rows(pair):
    """One array object for several runs, copies of it, or the rows of a matrix: the same bytes."""
    reference, source = pair
    rows, T_initial = subsets(1, len(source), 0.9, 6)[0], poses(3, 7)
    results = [
        icp.register(icp.Reference(reference), source, given, T_initial, PLANES)
        for given in ([rows] * 3, [rows.copy() for _ in range(3)], np.array([rows] * 3))
    ]
    assert len(np.unique(results[0].T_reference_source, axis=0)) == 3
    for result in results[1:]:
        assert result.T_reference_source.tobytes() == results[0].T_reference_source.tobytes()


def test_memory_does_not_grow_with_the_number_of_runs(pair, monkeypatch):
    """Only the runs of one batch are in memory together."""
    reference, source = pair
    shared = icp.Reference(reference)
    chain = icp.Chain(stopping=icp.Stopping(maximum_iterations=1))
    monkeypatch.setattr("icpshap.icp.registration.BATCH_BYTES", 1)
    peaks = []
    for runs in (20, 20, 220):  # the first call makes what the reference keeps
        rows, T_initial = [np.arange(len(source)) for _ in range(runs)], poses(runs, 7)
        tracemalloc.start()
        icp.register(shared, source, rows, T_initial, chain)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    positions = 4 * len(source)  # bytes a run
    assert peaks[2] - peaks[1] < 200 * positions / 5


def test_the_predicted_band_changes_nothing_but_rounding(pair, monkeypatch):
    """A prediction that always fails leads to the same poses by repeating every iteration."""
    reference, source = pair
    arguments = (source, subsets(4, len(source), 0.9, 6), poses(4, 7), PLANES)
    expected = icp.register(icp.Reference(reference), *arguments)

    def wrong(threshold, previous):
        return threshold * 2.0, threshold * 3.0, np.ones(len(threshold), dtype=bool)

    monkeypatch.setattr("icpshap.icp.accumulation.predicted_bands", wrong)
    repeated = icp.register(icp.Reference(reference), *arguments)
    np.testing.assert_allclose(repeated.T_reference_source, expected.T_reference_source, atol=1e-12)
    assert (repeated.iterations == expected.iterations).all()


def test_rounds_that_are_skipped_change_nothing_but_rounding(monkeypatch):
    """Runs that go in circles up to the maximum end where they end without skipping."""
    reference, source = room(1500, 1, noise=0.03), room(1500, 2, noise=0.03)
    arguments = (source, subsets(60, len(source), 0.5, 3), poses(60, 4))
    skipping = Circles.whole_rounds
    for maximum in (60, 61, 62, 63):
        chain = icp.Chain(stopping=icp.Stopping(maximum, 1e-5, 1e-5))
        skipped = []

        def counting(self, *arguments, skipped=skipped):
            rounds = skipping(self, *arguments)
            skipped.append(rounds.sum())
            return rounds

        monkeypatch.setattr(Circles, "whole_rounds", counting)
        result = icp.register(icp.Reference(reference), *arguments, chain)
        monkeypatch.setattr(Circles, "whole_rounds", lambda self, active, *_: 0 * active)
        expected = icp.register(icp.Reference(reference), *arguments, chain)
        assert sum(skipped) > 400
        assert list(result.status) == list(expected.status)
        np.testing.assert_array_equal(result.iterations, expected.iterations)
        np.testing.assert_array_equal(result.inlier_ratio, expected.inlier_ratio)
        np.testing.assert_allclose(
            result.T_reference_source, expected.T_reference_source, rtol=0, atol=1e-12
        )


def test_an_absurd_start_or_scale_costs_no_other_run(pair):
    """Lengths beyond single precision, and beyond any, are not taken for short ones."""
    reference, source = pair
    T_initial = poses(4, 4)
    T_initial[1, 0, 3] = 1e160
    for limit, far in ((None, 1e160), (1e25, 1e100)):
        T_initial[1, 0, 3] = far
        chain = icp.Chain(outlier_filter=icp.Trimmed(1.0), maximum_distance=limit)
        rows = subsets(4, len(source), 0.5, 3)
        result = icp.register(icp.Reference(reference), source, rows, T_initial, chain)
        assert result.status[1] == "too_few_links"
        assert set(result.status[[0, 2, 3]]) == {"ok"}
    scale = 1e22
    T_initial = poses(2, 4)
    T_initial[:, :3, 3] *= scale
    chain = icp.Chain(icp.PointToPoint(), 1, icp.Trimmed(0.7), maximum_distance=0.1 * scale)
    huge = icp.register(
        icp.Reference(reference * scale),
        source * scale,
        subsets(2, len(source), 0.5, 3),
        T_initial,
        chain,
    )
    assert (huge.iterations > 10).all() and (huge.inlier_ratio > 0.1).all()


def test_one_far_point_does_not_spoil_the_spatial_order():
    points = np.vstack([room(3000, 1), [1e9, 0, 0]])
    steps = np.linalg.norm(np.diff(points[spatial(points, np.arange(3000))], axis=0), axis=1)
    assert np.median(steps) < 0.5


def test_the_place_in_spatial_order_does_not_depend_on_the_other_points():
    points = room(3000, 1)
    rows = np.arange(3000)
    everything = spatial(points, rows)
    assert (np.sort(everything) == rows).all()
    half = np.flatnonzero(np.random.default_rng(2).random(3000) < 0.5)
    assert list(spatial(points, half)) == [row for row in everything if row in set(half)]
    steps = np.linalg.norm(np.diff(points[everything], axis=0), axis=1)
    assert np.median(steps) < np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)) / 10
    assert list(spatial(np.ones((4, 3)), np.array([1, 3]))) == [1, 3]


def test_full_lists_are_started_anew(pair, monkeypatch):
    reference, source = pair
    arguments = (source, subsets(4, len(source), 0.9, 6), poses(4, 7), PLANES)
    expected = icp.register(icp.Reference(reference), *arguments)
    shared = icp.Reference(reference)
    lists = shared.lists(3)
    lists.used[1] = len(lists.records) - 10_000
    nearly_full = icp.register(shared, *arguments)
    assert lists.used[1] < len(lists.records)
    for result in (nearly_full, icp.register(shared, *arguments)):
        assert result.T_reference_source.tobytes() == expected.T_reference_source.tobytes()


def test_lists_take_no_more_than_their_room_and_change_no_byte_without_it(pair, monkeypatch):
    reference, source = pair
    arguments = (source, subsets(4, len(source), 0.9, 6), poses(4, 7), PLANES)
    expected = icp.register(icp.Reference(reference), *arguments)
    monkeypatch.setattr("icpshap.icp.candidates.LARGEST_ROOM", 20_000)
    shared = icp.Reference(reference)
    little = icp.register(shared, *arguments)
    assert shared.lists(3).records.size == 20_000
    assert little.T_reference_source.tobytes() == expected.T_reference_source.tobytes()


def test_a_reference_keeps_its_points_once(pair):
    icp.Reference(pair[0][:20]).tree  # noqa: B018 (compiled, or read from the cache)
    tracemalloc.start()
    reference = icp.Reference(pair[0])
    assert len(reference.tree.points) == len(reference)
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert kept < 60 * len(reference)  # bytes: the tree takes 50; the points themselves were 24


def test_too_few_links_keep_the_pose_reached(pair):
    reference, source = pair
    T_initial = poses(4, 8)
    T_initial[1, 0, 3] = 50.0
    rows = [np.arange(100), np.arange(100), np.arange(1), np.array([], dtype=int)]
    chain = icp.Chain(maximum_distance=0.5)
    result = icp.register(icp.Reference(reference), source, rows, T_initial, chain)
    assert list(result.status[1:]) == ["too_few_links"] * 3
    assert list(result.iterations[1:]) == [0, 0, 0]
    np.testing.assert_allclose(result.T_reference_source[1:], T_initial[1:], atol=1e-12)
    assert result.inlier_ratio[1] == result.inlier_ratio[3] == 0
    assert np.isnan(result.rmse[1])
    assert result.status[0] in ("ok", "max_iterations")


def test_one_plane_is_degenerate():
    """A single plane lets the source slide and turn in it."""
    grid = np.stack(np.meshgrid(np.arange(30.0), np.arange(30.0), [0.0]), axis=-1).reshape(-1, 3)
    result = icp.register(
        icp.Reference(grid), grid + 0.1, [np.arange(len(grid))], np.eye(4)[None], PLANES
    )
    assert list(result.status) == ["degenerate"]
    np.testing.assert_array_equal(result.T_reference_source[0], np.eye(4))


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
def test_points_on_a_line_are_degenerate(direction):
    line = np.arange(20.0)[:, None] * direction
    result = icp.register(icp.Reference(line), line + 0.1, [np.arange(20)], np.eye(4)[None], POINTS)
    assert list(result.status) == ["degenerate"]


def test_three_points():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    T = poses(1, 3)[0]
    source = se3.transform(se3.inverse(T), points)
    chain = icp.Chain(icp.PointToPoint(), 1, icp.Trimmed(1.0))
    result = icp.register(icp.Reference(points), source, [np.arange(3)], np.eye(4)[None], chain)
    np.testing.assert_allclose(result.T_reference_source[0], T, atol=1e-9)
    with pytest.raises(ValueError, match="Normals from 7 neighbours need as many reference points"):
        icp.register(icp.Reference(points), source, [np.arange(3)], np.eye(4)[None], PLANES)
    with pytest.raises(ValueError, match="5 matches a point need as many reference points"):
        icp.register(
            icp.Reference(points), source, [np.arange(3)], np.eye(4)[None], icp.Chain(matches=5)
        )


def test_not_a_number_is_refused_at_the_door(pair):
    reference, source = pair
    spoilt = source.copy()
    spoilt[[4, 7], 1] = np.nan, np.inf
    with pytest.raises(ValueError, match=r"reference cloud: 2 of 6000 points .* row 4\. Hint:"):
        icp.Reference(spoilt)
    with pytest.raises(ValueError, match=r"source cloud: 2 of 6000 points are not finite"):
        icp.register(icp.Reference(reference), spoilt, [[0]], np.eye(4)[None], PLANES)


def test_runs_that_cannot_be_used_are_refused(pair):
    reference, source = icp.Reference(pair[0]), pair[1]
    T = np.eye(4)[None]
    with pytest.raises(ValueError, match=r"expected points of shape \(n, 3\)"):
        icp.Reference(np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"T_initial: expected \(2, 4, 4\)"):
        icp.register(reference, source, [[0], [1]], T, PLANES)
    with pytest.raises(ValueError, match="run 0 is not a rigid transformation"):
        icp.register(reference, source, [[0]], T * 2.0, PLANES)
    for rows in ([3, 1], [1, 1], [0, 6000], [-1, 2], [0.0, 1.0], [True, True], [[0], [1]]):
        with pytest.raises(ValueError, match="rows of run 0: expected ascending whole row numbers"):
            icp.register(reference, source, [rows], T, PLANES)
    with pytest.raises(ValueError, match=r"reference cloud: a coordinate of 3e\+160 m.*Hint:"):
        icp.Reference(3e160 * pair[0] / np.abs(pair[0]).max())


def test_a_run_without_points_has_too_few_links(pair):
    for rows in ([], np.array([]), np.array([], dtype=np.int32)):
        result = icp.register(icp.Reference(pair[0]), pair[1], [rows], np.eye(4)[None], PLANES)
        assert list(result.status) == ["too_few_links"]


def test_chains_that_cannot_be_built_are_refused():
    with pytest.raises(ValueError, match="matches must be 1, 2, 3, 4 or 5, not 6"):
        icp.Chain(matches=6)
    with pytest.raises(ValueError, match=r"ratio must be in \(0, 1\], not 0"):
        icp.Trimmed(0)
    with pytest.raises(ValueError, match="maximum_distance must be positive or None, not 0"):
        icp.Chain(maximum_distance=0)
    with pytest.raises(ValueError, match="maximum_iterations must be at least 1, not 0"):
        icp.Stopping(maximum_iterations=0)


def test_minimum_range_is_exclusive():
    points = np.array([[1.0, 0, 0], [0, 1.0 + 1e-12, 0], [0.5, 0.5, 0.5]])
    assert list(icp.minimum_range(points, 1.0)) == [False, True, False]


def test_the_first_job_says_once_that_it_compiles(caplog, tmp_path):
    from icpshap.icp.compiled import _announce, announce_compilation

    _announce.cache_clear()

    class Kernel:
        stats = type("Stats", (), {"cache_path": str(tmp_path)})

        @staticmethod
        def py_func():
            pass

    with caplog.at_level(logging.INFO):
        (tmp_path / "module.py_func-12.py311.nbi").touch()
        announce_compilation(Kernel())
        assert not caplog.records
        (tmp_path / "module.py_func-12.py311.nbi").unlink()
        announce_compilation(Kernel())
        announce_compilation(Kernel())  # of another function
    assert [record.message[:24] for record in caplog.records] == ["Compiling the ICP engine"]


@pytest.mark.slow
def test_a_million_points():
    reference, source = (room(1_000_000, seed, noise=1e-3) for seed in (1, 2))
    rows, T_initial = subsets(3, len(source), 0.02, 3), poses(3, 4)
    target = icp.Reference(reference)
    planes = icp.register(target, source, rows, T_initial, PLANES)
    assert set(planes.status) == {"ok"}
    np.testing.assert_allclose(planes.T_reference_source, np.tile(np.eye(4), (3, 1, 1)), atol=1e-3)
    chain = icp.Chain(icp.PointToPoint(), stopping=icp.Stopping(3))
    points = icp.register(target, source, rows[:1], T_initial[:1], chain)
    expected = plain_icp.register(
        reference, source[rows[0]], T_initial[0], planes=False, maximum_iterations=3
    )
    np.testing.assert_allclose(points.T_reference_source[0], expected[0], atol=1e-9)
