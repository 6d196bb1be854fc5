"""Simulated scans: the laser, the scenes, and that the same seed gives the same bytes."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.spatial import cKDTree

from icpshap import se3
from icpshap.data import simulate
from icpshap.data.ground_truth import ground_truth_distance
from icpshap.data.open3d_loader import load_open3d
from icpshap.data.scans import check_scan
from icpshap.data.scenes._parts import SENSOR_HEIGHT
from icpshap.errors import UserError

BEAMS = {
    "apartment": 14_000,
    "corridor": 12_000,
    "hall": 24_000,
    "plain": 18_500,
    "stairwell": 12_000,
    "street": 16_000,
}


def simulate_sequence(scene, scans, beams, seed):
    """Points of every scan, and the poses."""
    poses = simulate.simulate_poses(scene, scans, seed)
    clouds = [simulate.simulate_scan(scene, k, T, beams, seed) for k, T in enumerate(poses)]
    return clouds, poses


@pytest.fixture(scope="module")
def sequences():
    """The whole path through every scene."""
    return {
        scene: simulate_sequence(scene, simulate.maximum_scans(scene), beams, seed=3)
        for scene, beams in BEAMS.items()
    }


def consecutive(sequence):
    """(reference, source, T_reference_source) of every fifth consecutive pair."""
    clouds, poses = sequence
    for i in range(0, len(clouds) - 1, 5):
        yield clouds[i], clouds[i + 1], se3.inverse(poses[i]) @ poses[i + 1]


def test_scenes_are_those_documented():
    assert list(simulate.SCENES) == list(BEAMS)


@pytest.mark.parametrize("scene", BEAMS)
def test_points_poses_and_motion(sequences, scene):
    clouds, poses = sequences[scene]
    assert len(clouds) == len(poses) == simulate.maximum_scans(scene) >= 25
    for cloud in clouds:
        assert 10_000 <= len(cloud) <= 1.05 * BEAMS[scene]
        ranges = np.linalg.norm(cloud, axis=1)
        assert ranges.min() > simulate.MINIMUM_RANGE and ranges.max() < simulate.MAXIMUM_RANGE
        check_scan(cloud, 1.0, scene)
    np.testing.assert_allclose(
        poses[:, :3, :3] @ poses[:, :3, :3].mT, np.tile(np.eye(3), (len(poses), 1, 1)), atol=1e-12
    )
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    assert steps.min() > 0.25 and steps.max() <= 0.7


@pytest.mark.parametrize("scene", BEAMS)
def test_consecutive_scans_overlap_and_fit_at_the_exact_poses(sequences, scene):
    least = {"hall": 0.5, "plain": 0.5, "street": 0.5}.get(scene, 0.6)
    for reference, source, T_reference_source in consecutive(sequences[scene]):
        distances = cKDTree(reference).query(se3.transform(T_reference_source, source))[0]
        assert np.mean(distances <= 0.2) > least
        arguments = (reference, source, T_reference_source, 1.0)
        assert ground_truth_distance(*arguments)[1] == ""


@pytest.mark.parametrize("scene", BEAMS)
def test_a_few_points_are_the_robot(scene):
    open3d = load_open3d()
    directions = simulate._beam_directions()
    robot = simulate._raycaster(open3d, simulate._robot(open3d))
    ranges = simulate._cast(robot, np.zeros_like(directions), directions)
    seen = ranges[np.isfinite(ranges)]
    assert 0.02 < len(seen) / len(directions) < 0.05
    assert seen.max() < 1.0


def test_the_apartment_is_where_its_plan_says(sequences):
    clouds, poses = sequences["apartment"]
    points = np.concatenate(
        [
            se3.transform(T, cloud[np.linalg.norm(cloud, axis=1) > 1])
            for T, cloud in zip(poses, clouds, strict=True)
        ]
    )
    assert np.all(points > [-0.2, -0.2, -0.1]) and np.all(points < [10.2, 8.2, 2.7])
    # Floor, ceiling, and the inner faces of the outer walls.
    for axis, value in [(2, 0.0), (2, 2.6), (0, 0.05), (0, 9.95), (1, 0.05), (1, 7.95)]:
        assert np.mean(np.abs(points[:, axis] - value) < 0.03) > 0.01


def test_a_beam_straight_down_measures_the_sensor_height():
    open3d = load_open3d()
    world = simulate._raycaster(open3d, simulate.SCENES["apartment"].build(open3d))
    origin = np.array([[3.0, 3.0, SENSOR_HEIGHT]] * 2)
    ranges = simulate._cast(world, origin, np.array([[0.0, 0, -1], [0, 0, 1]]))
    np.testing.assert_allclose(ranges, [SENSOR_HEIGHT, 2.6 - SENSOR_HEIGHT])


def test_laser_fan_and_tilt():
    directions = simulate._beam_directions()
    fans, beams = simulate.FULL_RESOLUTION
    assert len(directions) == fans * beams
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-12)
    # Tilting about y leaves the lateral component: 270 degrees reach back to -sin(135 degrees).
    fan = directions[: np.flatnonzero(np.diff(directions[:, 1]) < -1)[0] + 1]
    angles = np.unwrap(np.arctan2(fan[:, 1], fan[:, 0] / np.cos(simulate.TILT)))
    assert np.rad2deg(angles[-1] - angles[0]) == pytest.approx(270)
    np.testing.assert_allclose(np.diff(angles), np.diff(angles)[0])


def test_range_noise_and_dropouts_are_as_stated(monkeypatch):
    monkeypatch.setattr(simulate, "DROPOUTS", 0.0)
    (noisy,), _ = simulate_sequence("stairwell", 1, 12_000, seed=5)
    (T,) = simulate.simulate_poses("stairwell", 1, seed=5)
    exact = simulate.simulate_scan("stairwell", 0, T, 12_000, 5, range_noise=(0.0, 0.0))
    error = np.linalg.norm(noisy, axis=1) - np.linalg.norm(exact, axis=1)
    assert error.std() == pytest.approx(0.01, rel=0.03) and abs(error.mean()) < 5e-4
    monkeypatch.setattr(simulate, "DROPOUTS", 0.1)
    (thinned,), _ = simulate_sequence("stairwell", 1, 12_000, seed=5)
    assert 1 - len(thinned) / len(exact) == pytest.approx(0.1, abs=0.01)


def as_bytes(sequence):
    clouds, poses = sequence
    return b"".join(cloud.tobytes() for cloud in [*clouds, poses])


@pytest.mark.parametrize("scene", BEAMS)
def test_same_seed_same_bytes_also_in_parallel_threads(scene):
    arguments = (scene, 2, 2_000, 11)
    with ThreadPoolExecutor(2) as pool:
        parallel = list(pool.map(lambda _: simulate_sequence(*arguments), range(4)))
    assert len({as_bytes(sequence) for sequence in parallel}) == 1
    assert as_bytes(simulate_sequence(*arguments)) == as_bytes(parallel[0])
    assert as_bytes(simulate_sequence(*arguments[:3], 12)) != as_bytes(parallel[0])


def test_a_scan_does_not_depend_on_how_many_follow():
    few, few_poses = simulate_sequence("plain", 2, 2_000, 1)
    more, more_poses = simulate_sequence("plain", 4, 2_000, 1)
    np.testing.assert_array_equal(few_poses, more_poses[:2])
    for a, b in zip(few, more, strict=False):
        np.testing.assert_array_equal(a, b)


def test_full_resolution_scan():
    (cloud,), _ = simulate_sequence("stairwell", 1, 367_540, 1)
    assert 350_000 < len(cloud) < 367_540


def test_more_scans_than_the_path_holds():
    limit = simulate.maximum_scans("plain")
    with pytest.raises(UserError, match=rf"scans: {limit + 1} do not fit .* at most {limit} do"):
        simulate_sequence("plain", limit + 1, 1_000, 1)


def test_more_beams_than_a_full_scan_has():
    with pytest.raises(UserError, match="beams: 400000 are more than the 367540 of a full scan"):
        simulate.simulate_scan("plain", 0, np.eye(4), 400_000, 1)


def turn(scene="apartment", rings=16, beams=16_000, **options):
    T = simulate.simulate_poses(scene, 1, seed=1)[0]
    return simulate.simulate_scan(scene, 0, T, beams, 1, rings=rings, **options), T


@pytest.mark.parametrize("rings", [16, 32, 128])
def test_a_spinning_scanner_has_rings_of_one_elevation(rings):
    points, _ = turn(rings=rings, beams=1000 * rings, range_noise=0.0)
    elevation = np.rad2deg(np.arctan2(points[:, 2], np.linalg.norm(points[:, :2], axis=1)))
    steps = np.linspace(22.5, -22.5, rings)
    nearest = np.abs(elevation[:, None] - steps).argmin(axis=1)
    np.testing.assert_allclose(elevation, steps[nearest], atol=1e-9)
    assert len(np.unique(nearest)) == rings
    assert 0.8 * 1000 * rings < len(points) <= 1000 * rings


def test_range_noise_of_a_spinning_scanner():
    noisy, clean = (turn(range_noise=noise)[0] for noise in (None, 0.0))
    ranges = [np.linalg.norm(points, axis=1) for points in (noisy, clean)]
    assert np.std(ranges[0] - ranges[1]) == pytest.approx(0.02, rel=0.05)


def test_a_scanner_that_moves_casts_its_beams_from_where_it_is(monkeypatch):
    """From half a turn before its pose to half a turn after it, straight ahead."""
    origins = []

    def cast(raycaster, origin, directions):
        origins.append(np.broadcast_to(origin, directions.shape))
        return np.full(len(directions), 5.0)

    monkeypatch.setattr(simulate, "_cast", cast)
    points, T = turn(beams=16 * 500, speed=10.0, range_noise=0.0)
    ahead = (origins[0] - T[:3, 3]) @ T[:3, :3]
    np.testing.assert_allclose(ahead[::16, 0], np.linspace(-0.499, 0.499, 500), atol=1e-9)
    np.testing.assert_allclose(ahead[:, 1:], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 5.0)
