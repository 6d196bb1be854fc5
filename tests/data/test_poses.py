"""Poses of every format, and what must be right about them."""

import numpy as np
import pytest
from known_files import POSES, written
from misbehaving_server import poses_csv
from scipy.spatial.transform import Rotation

from icpshap.data.poses import read_poses
from icpshap.errors import DataError


def test_data_set_poses(tmp_path):
    path = written(tmp_path / "p.csv", poses_csv(POSES))
    np.testing.assert_array_equal(read_poses(path, 4), POSES)


@pytest.mark.parametrize("width", [12, 16])
@pytest.mark.parametrize("separator", [" ", ","])
def test_kitti_poses(tmp_path, width, separator):
    path = tmp_path / "poses.txt"
    np.savetxt(path, POSES.reshape(4, 16)[:, :width], fmt="%.17g", delimiter=separator)
    np.testing.assert_array_equal(read_poses(path, 4), POSES)


def test_tum_poses(tmp_path):
    quaternions = Rotation.from_matrix(POSES[:, :3, :3]).as_quat()  # x y z w
    rows = np.column_stack([np.arange(4) / 10, POSES[:, :3, 3], quaternions])
    path = tmp_path / "poses.tum"
    np.savetxt(path, rows, header="timestamp tx ty tz qx qy qz qw", fmt="%.17g")
    np.testing.assert_allclose(read_poses(path, 4), POSES, atol=1e-14)
    np.savetxt(path, rows, fmt="%.4f")  # the format's habit
    np.testing.assert_allclose(read_poses(path, 4), POSES, atol=3e-4)


IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ": no poses."),
        ("# only a comment\n", ": no poses."),
        ("1 2 3\n", ", line 1: 3 columns; expected 12 or 16 (KITTI), 8 (TUM)"),
        (f"{IDENTITY}\n{IDENTITY[:-2]}\n", ", line 2: 11 columns, expected 12."),
        (f"{IDENTITY}\n{IDENTITY[:-1]}a\n", ", line 2, column 12: 'a' is not a finite number."),
        (f"{IDENTITY}\n{IDENTITY[:-1]}nan\n", ", line 2, column 12: 'nan' is not a finite"),
        (f"{IDENTITY}\n1.001{IDENTITY[1:]}\n", ", line 2: the 3x3 part is not a rotation"),
        (f"-1{IDENTITY[1:]}\n", ", line 1: the 3x3 part is not a rotation"),
        (f"{IDENTITY} 0 0 1 1\n", ", line 1: the last row of the matrix is [0.0, 0.0, 1.0, 1.0]"),
        ("0 1 2 3 0 0 0 1.001\n", ", line 1: quaternion of norm 1.001, expected 1"),
        ("1 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 1\n", ", line 2: the timestamp is not later"),
    ],
)
def test_bad_poses(tmp_path, text, expected):
    path = written(tmp_path / "poses.txt", text)
    with pytest.raises(DataError) as error:
        read_poses(path, 2)
    assert str(error.value).startswith(f"{path}{expected}"), error.value
    assert "\nHint: " in str(error.value)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda lines: lines[:-1], ": 3 poses, but the configuration says `scans: 4`."),
        (lambda lines: [*lines, lines[-1].replace("3,", "4,", 1)], ": 5 poses, but the conf"),
        (lambda lines: lines[:2] + lines[3:], ", line 3: poseId 2, expected 1."),
        (lambda lines: lines[:1] + lines[2:], ", line 2: poseId 1, expected 0."),
        (
            lambda lines: [*lines[:-1], lines[-1].rsplit(",", 2)[0]],
            ", line 5: 16 columns, expected 18.",
        ),
        (lambda lines: [lines[0].replace("T13", "T14"), *lines[1:]], ", line 1: columns poseId"),
    ],
)
def test_bad_data_set_poses(tmp_path, change, expected):
    lines = poses_csv(POSES).splitlines()
    path = written(tmp_path / "pose_scanner_leica.csv", "\n".join(change(lines)))
    with pytest.raises(DataError) as error:
        read_poses(path, 4)
    assert str(error.value).startswith(f"{path}{expected}"), error.value


def test_pose_count_names_the_line_to_change(tmp_path):
    path = written(tmp_path / "p.csv", poses_csv(POSES))
    with pytest.raises(DataError, match=r"change `scans: 45` to `scans: 4`"):
        read_poses(path, 45)


def test_a_single_pose_is_no_reason_to_ask_for_a_single_scan(tmp_path):
    path = written(tmp_path / "p.txt", IDENTITY)
    with pytest.raises(DataError, match=r"1 poses, but .*`scans: 2`") as error:
        read_poses(path, 2)
    assert "and at least 2 scans; the file may be cut off" in str(error.value)
    assert "`scans: 1`" not in str(error.value)


def test_rotations_are_accepted_up_to_the_tolerance(tmp_path):
    path = written(tmp_path / "p.txt", f"1.00004{IDENTITY[1:]}\n")
    assert read_poses(path, 1)[0, 0, 0] == 1.00004  # read, not corrected
    path = written(tmp_path / "p.txt", f"1.00006{IDENTITY[1:]}\n")
    with pytest.raises(DataError, match="not a rotation"):
        read_poses(path, 1)
