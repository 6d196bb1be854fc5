"""Right and wrong true motions between two scans."""

import os
from pathlib import Path

import numpy as np
import pytest
from known_files import walls_of

from icpshap import se3
from icpshap.data.folder import find_folder_files
from icpshap.data.ground_truth import ground_truth_distance
from icpshap.data.poses import read_poses
from icpshap.data.scans import read_scan


@pytest.fixture(scope="module")
def room_pair():
    """Two scans of a 6 m x 4 m x 3 m box of 20,000 points, and of the robot, which moves along."""
    generator = np.random.default_rng(3)
    walls = walls_of(np.array([6.0, 4.0, 3.0]), 20_000, generator)
    T_global_local = se3.exp([[0, 0, 0.2, 2.0, 1.5, 1.2], [0, 0, 0.5, 2.5, 2.0, 1.2]])
    robot = generator.uniform(-0.3, 0.3, (30_000, 3))
    reference, source = (
        np.concatenate(
            [se3.transform(se3.inverse(T), walls + generator.normal(0, 0.01, walls.shape)), robot]
        )
        for T in T_global_local
    )
    return reference, source, se3.inverse(T_global_local[0]) @ T_global_local[1]


def test_right_ground_truth_gives_no_warning(room_pair):
    distance, warning = ground_truth_distance(*room_pair, minimum_range=1.0)
    assert 0.005 < distance < 0.05 and warning == ""


def test_distance_is_the_median_over_the_points_beyond_the_range():
    reference = np.array([[10.0, 0, 0], [20, 0, 0], [30, 0, 0], [0.1, 0, 0]])
    source = np.array([[10.01, 0, 0], [20, 0.02, 0], [30, 0, 0.03], [0.1, 0, 0], [0, 0.1, 0]])
    distance, _ = ground_truth_distance(reference, source, np.eye(4), 1.0)
    assert distance == pytest.approx(0.02)


def test_wrong_ground_truth_is_noticed(room_pair):
    reference, source, T = room_pair
    _, warning = ground_truth_distance(reference, source, se3.inverse(T), 1.0)
    assert "the ground truth looks wrong: with the inverse motion" in warning and "Hint" in warning
    transposed = T.copy()
    transposed[:3, :3] = T[:3, :3].T
    _, warning = ground_truth_distance(reference, source, transposed, 1.0)
    assert "looks wrong: with the transposed rotation" in warning and "row-major" in warning
    still = reference + np.array([0.002, 0, 0])
    _, warning = ground_truth_distance(reference, still, T, 1.0)
    assert "looks wrong: with no motion at all" in warning and "line k" in warning
    small = T @ se3.exp([0, 0, 0.01, 0, 0, 0])
    assert ground_truth_distance(reference, source, small, 1.0)[1] == ""
    far = T.copy()
    far[2, 3] += 50.0
    distance, warning = ground_truth_distance(reference, source, far, 1.0)
    assert distance > 40 and "looks wrong" in warning


def test_scans_that_hardly_overlap_are_noticed(room_pair):
    reference, _, _ = room_pair
    away = reference + np.array([100.0, 0, 0])
    distance, warning = ground_truth_distance(reference, away, np.eye(4), 1.0)
    assert distance > 90 and "hardly overlap" in warning


def test_real_pair():
    folder = os.environ.get("ICPSHAP_REAL_DATA")
    if not folder:
        pytest.skip("set ICPSHAP_REAL_DATA to the folder that holds apartment_pair/")
    paths, pose_path = find_folder_files(Path(folder) / "apartment_pair", 2)
    T = read_poses(pose_path, 2)
    reference, source = (read_scan(path)[0] for path in paths)
    assert (len(reference), len(source)) == (36_674, 36_670)
    T_reference_source = se3.inverse(T[0]) @ T[1]
    distance, warning = ground_truth_distance(reference, source, T_reference_source, 1.0)
    assert distance == pytest.approx(0.032, abs=0.002) and warning == ""
    T_wrong = se3.inverse(T_reference_source)
    assert ground_truth_distance(reference, source, T_wrong, 1.0)[1]
