"""Poses of every format, and what must be right about them."""

import numpy as np
import pytest
from known_files import POSES, walls_of, written
from misbehaving_server import poses_csv
from scipy.spatial.transform import Rotation

from icpshap import se3
from icpshap.data.folder import find_folder_files
from icpshap.data.poses import read_poses, read_transforms
from icpshap.data.scans import read_scan
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


# One transform for two scans


TRANSFORM = POSES[1]
LINES = {
    "16 numbers": lambda T: [T.ravel()],
    "12 numbers": lambda T: [T[:3].ravel()],
    "a 4x4 matrix": lambda T: T,
    "a 3x4 matrix": lambda T: T[:3],
}


def matrix_text(rows, separator=" "):
    return "".join(separator.join(map(repr, map(float, row))) + "\n" for row in rows)


@pytest.mark.parametrize("separator", [" ", ", "])
@pytest.mark.parametrize("form", LINES)
def test_one_transform_for_a_pair(tmp_path, form, separator):
    """It moves the source, scan 1, onto the reference, scan 0."""
    path = written(tmp_path / "T.txt", matrix_text(LINES[form](TRANSFORM), separator))
    poses = read_poses(path, 2)
    np.testing.assert_array_equal(poses, [np.eye(4), TRANSFORM])
    np.testing.assert_array_equal(read_transforms(path), TRANSFORM[None])


@pytest.mark.parametrize(
    ("text", "scans", "expected"),
    [
        (matrix_text(TRANSFORM), 3, ": one transform, but the configuration says `scans: 3`"),
        (matrix_text(TRANSFORM[:2]), 2, ": 2 rows of 4 numbers, expected 3 or 4, of one matrix"),
        (matrix_text(2 * TRANSFORM[:3]), 2, ", line 1: the 3x3 part is not a rotation"),
        (matrix_text(TRANSFORM.T), 2, ", line 1: the last row of the matrix is"),
        (matrix_text([TRANSFORM[:3].ravel()]), 3, ": 1 poses, but the configuration says"),
        (matrix_text(np.eye(4)), 2, ": 1 poses, but the configuration says `scans: 2`; taken for"),
    ],
)
def test_transforms_that_are_wrong(tmp_path, text, scans, expected):
    path = written(tmp_path / "T.txt", text)
    with pytest.raises(DataError) as error:
        read_poses(path, scans)
    assert str(error.value).startswith(f"{path}{expected}"), error.value


def test_no_motion_is_a_guess_but_no_pose(tmp_path):
    path = written(tmp_path / "T.txt", matrix_text(np.eye(4)))
    np.testing.assert_array_equal(read_transforms(path), np.eye(4)[None])


def test_several_transforms(tmp_path):
    path = written(tmp_path / "T.txt", matrix_text(T[:3].ravel() for T in POSES))
    np.testing.assert_array_equal(read_transforms(path), POSES)
    for text, expected in (
        ("", "no transforms"),
        ("0 1 2 3 0 0 0 1\n", "8 columns, expected 16, 12 or 7"),
        (f"{IDENTITY}\n2{IDENTITY[1:]}\n", "line 2: the 3x3 part is not a rotation"),
        ("1 2 3 0 0 0 1\n1 2 3 0 0 0 2\n", "line 2: quaternion of norm 2"),
        ("1 2 3 0 0 0 1\n1 2 3 0 0 0\n", "line 2: 6 columns, expected 7"),
    ):
        with pytest.raises(DataError, match=expected):
            read_transforms(written(path, text))


def test_a_transform_may_be_a_translation_and_a_quaternion(tmp_path):
    numbers = [*TRANSFORM[:3, 3], *Rotation.from_matrix(TRANSFORM[:3, :3]).as_quat()]
    path = written(tmp_path / "T.txt", matrix_text([numbers]))
    np.testing.assert_allclose(read_transforms(path), TRANSFORM[None], atol=1e-12)


# Poses of a longer drive


DRIVE = se3.exp(np.random.default_rng(3).normal(0, 0.5, (40, 6)))
STAMPS = 1305031102.175304 + 0.1 * np.arange(40)


def drive_of(path, stamps=None):
    """A pose file of the drive; TUM if there are stamps."""
    if stamps is None:
        return written(path, matrix_text(T[:3].ravel() for T in DRIVE))
    quaternions = Rotation.from_matrix(DRIVE[:, :3, :3]).as_quat()
    rows = np.column_stack([stamps, DRIVE[:, :3, 3], quaternions])
    np.savetxt(path, rows, fmt="%.9f", header="timestamp tx ty tz qx qy qz qw")
    return path


@pytest.mark.parametrize(
    "names",
    [
        ["000010.bin", "000012.bin", "000039.bin"],
        ["velodyne_64/10.pcd.gz", "velodyne_64/12.pcd.gz", "velodyne_64/39.pcd.gz"],
        ["scan_10/cloud.ply", "scan_12/cloud.ply", "scan_39/cloud.ply"],
    ],
)
def test_scans_are_found_by_their_numbers(tmp_path, names):
    for path in (drive_of(tmp_path / "p.txt"), drive_of(tmp_path / "p.tum", STAMPS)):
        found = read_poses(path, 3, names)
        np.testing.assert_allclose(found, DRIVE[[10, 12, 39]], atol=1e-8)


@pytest.mark.parametrize(
    "written_as",
    [
        lambda t: f"{t:.6f}.pcd",
        lambda t: f"cloud_{t:.3f}.ply",
        lambda t: f"{round(t * 1e3)}.bin",
        lambda t: f"{round(t * 1e6)}.bin",
        lambda t: f"lidar/{round(t * 1e9)}.bin",
    ],
)
def test_scans_are_found_by_their_times(tmp_path, written_as):
    names = [written_as(t) for t in STAMPS[[3, 4, 20]]]
    found = read_poses(drive_of(tmp_path / "p.tum", STAMPS), 3, names)
    np.testing.assert_allclose(found, DRIVE[[3, 4, 20]], atol=1e-8)


@pytest.mark.parametrize(
    ("stamps", "names", "expected"),
    [
        (None, ["a.ply", "b.ply"], "whose names (a.ply, b.ply) do not say which are theirs"),
        (None, ["38.ply", "40.ply"], "do not say which are theirs; expected the times of their"),
        (STAMPS, ["1305031102.2.ply", "1305031102.3.ply"], "do not say which are theirs"),
        (0.5 * np.arange(40), ["10.ply", "12.ply"], "fit some of them by their times, and others"),
    ],
)
def test_scans_that_are_not_certain_to_be_found(tmp_path, stamps, names, expected):
    path = drive_of(tmp_path / "p.txt", stamps)
    with pytest.raises(DataError) as error:
        read_poses(path, 2, names)
    message = str(error.value)
    assert message.startswith(f"{path}: 40 poses for 2 scans") and expected in message
    assert "\nHint: leave just the poses of the scans in the file" in message


def test_a_pose_for_each_scan_needs_no_names(tmp_path):
    names = [f"{number}.ply" for number in range(1, 41)]
    np.testing.assert_allclose(read_poses(drive_of(tmp_path / "p.txt"), 40, names), DRIVE)


# Where quaternions have qw


@pytest.fixture(scope="module")
def walk():
    """Scans of a hall from a scanner that turns by little and walks, and their poses (5, 4, 4)."""
    generator = np.random.default_rng(4)
    walls = walls_of(np.array([9.0, 7.0, 3.0]), 30_000, generator)
    walls[:9000] = generator.uniform([2, 2, 0], [2.5, 3, 2], (9000, 3))
    steps = np.arange(5)[:, None]
    xi = np.hstack([0.05 * steps, 0.02 * steps, 0.15 * steps, 3 + 0.4 * steps, 4 - 0.2 * steps])
    poses = se3.exp(np.hstack([xi, np.full((5, 1), 1.2)]))
    return [se3.transform(se3.inverse(T), walls) for T in poses], poses


def tum_of(path, poses, order, **options):
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=order == "wxyz")
    rows = np.column_stack([np.arange(len(poses)), poses[:, :3, 3], quaternions])
    np.savetxt(path, rows, fmt="%.12f", **options)
    return path


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_the_order_that_passes_the_check_of_ground_truth(tmp_path, walk, order):
    scans, poses = walk
    path = tum_of(tmp_path / "p.tum", poses, order)
    np.testing.assert_allclose(read_poses(path, 5, scan=scans.__getitem__), poses, atol=1e-10)
    np.testing.assert_allclose(read_poses(path, 5, quaternion=order), poses, atol=1e-10)


def test_scans_at_rest_fit_both_orders(tmp_path, walk):
    scans, poses = walk
    path = tum_of(tmp_path / "p.tum", poses[[0, 0]], "xyzw")
    with pytest.raises(DataError, match=r"not certain where .* the scans fit both orders") as error:
        read_poses(path, 2, scan=lambda index: scans[0])
    assert "`quaternion: xyzw` of the folder for qx qy qz qw" in str(error.value)


def test_scans_that_fit_neither_order_leave_it_as_it_is_usual(tmp_path, walk):
    scans, poses = walk
    far = poses.copy()
    far[:, :3, 3] *= 40
    path = tum_of(tmp_path / "p.tum", far, "xyzw")
    np.testing.assert_allclose(read_poses(path, 5, scan=scans.__getitem__), far, atol=1e-9)


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_a_comment_says_the_order(tmp_path, walk, order):
    _, poses = walk
    names = {"xyzw": "qx qy qz qw", "wxyz": "qw qx qy qz"}
    path = tum_of(tmp_path / "p.tum", poses, order, header=f"timestamp tx ty tz {names[order]}")
    np.testing.assert_allclose(read_poses(path, 5), poses, atol=1e-10)
    other = "wxyz" if order == "xyzw" else "xyzw"
    expected = f"`quaternion: {other}`, but a comment in the file says {names[order]}"
    with pytest.raises(DataError, match=expected):
        read_poses(path, 5, quaternion=other)


@pytest.mark.parametrize("name", ["apartment_pair", "spinning_pair"])
@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_the_order_of_real_poses(real_data, tmp_path, name, order):
    paths, pose_path = find_folder_files(real_data / name, 2)
    poses = read_poses(pose_path, 2)
    start = se3.exp([0.3, -0.2, 1.1, 2.0, 1.0, 0.5])  # a frame that turns none of them to identity
    path = tum_of(tmp_path / "p.tum", start @ poses, order)
    found = read_poses(path, 2, scan=lambda index: read_scan(paths[index])[0])
    np.testing.assert_allclose(found, start @ poses, atol=1e-4)
