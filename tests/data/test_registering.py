"""Poses that ICP makes: right where scans say enough, an error by name where they do not."""

import numpy as np
import pytest

from icpshap import se3
from icpshap.data import registering, simulate
from icpshap.data.registering import chained, guesses, register_scans
from icpshap.errors import DataError

FAR = se3.exp([0.1, -0.05, 2.2, 1.5, -1.0, 0.1])


def error_of(found, T):
    xi = se3.log(se3.inverse(T) @ found.T_reference_source)
    return np.rad2deg(np.linalg.norm(xi[:3])), np.linalg.norm(xi[3:])


@pytest.fixture(scope="module")
def hall():
    """Points of a hall, on its walls and on what stands in it, as a function of their number."""
    generator = np.random.default_rng(6)
    size = np.array([9.0, 6.0, 3.0])

    def points(count=8000):
        found = generator.uniform(0, size, (count, 3))
        axis = generator.integers(0, 3, count)
        found[np.arange(count), axis] = generator.integers(0, 2, count) * size[axis]
        found[: count // 4] = generator.uniform([6, 1, 0], [6.8, 2.5, 2], (count // 4, 3))
        return found - [4, 3, 1.2]

    return points


@pytest.mark.parametrize(
    "T",
    [np.eye(4), se3.exp([0.02, -0.01, 0.1, 0.4, -0.2, 0.05]), se3.exp([0, 0, 0.4, 0.8, 0.3, 0])],
    ids=["no motion", "small", "large"],
)
def test_known_motions_from_no_motion(hall, T):
    found = register_scans(hall(), se3.transform(se3.inverse(T), hall()), np.eye(4), "hall")
    rotation, translation = error_of(found, T)
    assert rotation < 0.2 and translation < 0.02
    assert found.overlap > 0.9 and found.iterations > 3 and found.rmse < 0.1


def test_a_guess_is_where_icp_starts(hall):
    reference, source = hall(), se3.transform(se3.inverse(FAR), hall())
    near = FAR @ se3.exp([0.05, 0, 0.1, 0.2, -0.1, 0])
    rotation, translation = error_of(register_scans(reference, source, near, "hall"), FAR)
    assert rotation < 0.2 and translation < 0.02


def test_the_rounding_of_a_guess_is_not_in_the_answer(hall):
    T = np.round(se3.exp([0.02, -0.01, 0.1, 0.4, -0.2, 0.05]), 4)
    found = register_scans(hall(), se3.transform(se3.inverse(T), hall()), T, "hall")
    rotation = found.T_reference_source[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_the_same_bytes_each_time(hall):
    reference, source = hall(), hall()
    found = [register_scans(reference, source, np.eye(4), "hall") for _ in range(2)]
    np.testing.assert_array_equal(*(each.T_reference_source for each in found))


@pytest.mark.parametrize("scene", ["apartment", "stairwell", "plain"])
def test_simulated_scans(scene):
    poses = simulate.simulate_poses(scene, 2, 1)
    scans = [simulate.simulate_scan(scene, k, poses[k], 10_000, 1) for k in range(2)]
    found = register_scans(*scans, np.eye(4), scene)
    rotation, translation = error_of(found, se3.inverse(poses[0]) @ poses[1])
    assert rotation < 0.2 and translation < 0.02


@pytest.mark.slow
def test_scans_that_hardly_overlap(hall):
    elsewhere = hall()[hall()[:, 0] > 1] * [1, 1, 0.2] + [30, 0, 0]
    expected = r"^drive, scans 3 and 4: did not register: at ICP's answer \d+ % of the source"
    with pytest.raises(DataError, match=expected) as error:
        generator = np.random.default_rng(1)
        ball = generator.normal(0, 1, (4000, 3))
        ball *= 20 / np.linalg.norm(ball, axis=1, keepdims=True)
        register_scans(np.concatenate([hall(), elsewhere]), ball, np.eye(4), "drive, scans 3 and 4")
    assert "let ICP start nearer to the answer (`guess` of the folder)" in str(error.value)


def test_icp_that_does_not_settle(hall, monkeypatch):
    monkeypatch.setattr(registering, "ITERATIONS", 2)
    with pytest.raises(DataError, match="hall: did not register: ICP ended with max_iterations"):
        register_scans(hall(), hall(), np.eye(4), "hall")


def test_scans_of_a_few_places():
    points = np.repeat(np.eye(3) * 5, 500, axis=0)
    with pytest.raises(DataError, match=r"hall: 3 points are left of a scan in cubes of 0\.125 m"):
        register_scans(points, points, np.eye(4), "hall")


def test_transforms_are_chained_from_the_first_scan_on():
    T_between = se3.exp(np.random.default_rng(0).normal(0, 0.5, (3, 6)))
    poses = chained(T_between)
    np.testing.assert_array_equal(poses[0], np.eye(4))
    np.testing.assert_allclose(se3.inverse(poses[:-1]) @ poses[1:], T_between, atol=1e-14)
    np.testing.assert_array_equal(chained(T_between[:2]), poses[:3])


def test_guesses_are_one_for_all_or_one_for_each():
    one = se3.exp([[0, 0, 0.1, 0, 0, 0]])
    np.testing.assert_array_equal(guesses(one, 4, "g.txt"), np.tile(one, (3, 1, 1)))
    three = np.tile(np.eye(4), (3, 1, 1))
    assert guesses(three, 4, "g.txt").shape == (3, 4, 4)
    with pytest.raises(DataError, match=r"g\.txt: 3 transforms, expected 1 or 4"):
        guesses(three, 5, "g.txt")
