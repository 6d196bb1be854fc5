import os
from pathlib import Path

import numpy as np
import pytest
from misbehaving_server import poses_csv, scan_csv, write_folder
from scipy.spatial.transform import Rotation

from icpshap import se3
from icpshap.data import scans as dataset
from icpshap.data.open3d_loader import load_open3d
from icpshap.data.scans import DataError

POINTS = np.random.default_rng(1).normal(0, 5, (1200, 3))
POSES = se3.exp(np.random.default_rng(2).normal(0, 0.5, (4, 6)))


def written(path, text):
    path.write_text(text)
    return path


def problem(path, expected, **options):
    """The whole message of the error of reading a scan; its beginning is checked."""
    with pytest.raises(DataError) as error:
        dataset.read_scan(path, **options)
    message = str(error.value)
    assert message.startswith(f"{path}{expected}"), message
    assert "\nHint: " in message
    return message


# Scans


def test_hokuyo_scan_is_read_to_the_last_digit(tmp_path):
    path = written(tmp_path / "Hokuyo_0.csv", scan_csv(POINTS))
    points, dropped = dataset.read_scan(path)
    np.testing.assert_array_equal(points, POINTS)
    assert points.dtype == float and dropped == 0


def test_own_csv_is_read_by_column_names(tmp_path):
    text = "\ufeffz, intensity, x, y\r\n3,,1,2\r\n6,bright, 4 ,5e0\r\n"
    path = tmp_path / "own.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(dataset.read_scan(path)[0], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("options", [{"write_ascii": True}, {}, {"compressed": True}])
def test_ply_and_pcd(tmp_path, suffix, options):
    path = write_cloud(tmp_path / f"scan{suffix}", POINTS, **options)
    np.testing.assert_allclose(
        dataset.read_scan(path)[0], POINTS, atol=5e-5, rtol=0
    )  # ASCII: 6 digits


def write_cloud(path, points, **options):
    open3d = load_open3d()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.paint_uniform_color((0.5, 0.5, 0.5))
    assert open3d.io.write_point_cloud(str(path), cloud, **options)
    return path


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("options", [{"write_ascii": True}, {}, {"compressed": True}])
@pytest.mark.parametrize("kept", [0.999, 0.5, 0.01, 0.0])
def test_cut_off_ply_and_pcd(tmp_path, suffix, options, kept):
    path = write_cloud(tmp_path / f"scan{suffix}", POINTS, **options)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * kept)])
    message = problem(path, ": ")
    assert "the file ends before the last one" in message or "no readable" in message


def test_text_that_is_no_point_cloud(tmp_path):
    assert "no readable .ply header" in problem(written(tmp_path / "a.ply", "hello\n"), ": no ")
    assert "no readable .pcd header" in problem(written(tmp_path / "a.pcd", "hello\n"), ": no ")


PLY = """ply
format ascii 1.0
comment a scan
element vertex 3
property float intensity
property float x
property float y
property uchar z
element face 1
property list uchar int vertex_indices
end_header
0 1 2 3
{row}
0 7 8 9
3 0 1 2
"""
PCD = """VERSION 0.7
FIELDS intensity x y z
SIZE 4 4 4 4
TYPE F F F F
COUNT 1 1 1 1
WIDTH 3
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 3
DATA ascii
0 1 2 3
{row}
0 7 8 9
"""
ASCII = [("a.ply", PLY, 13), ("a.pcd", PCD, 12)]  # and the line of the row


@pytest.mark.parametrize(("name", "text", "line"), ASCII)
def test_ascii_columns_are_found_by_name(tmp_path, name, text, line):
    path = written(tmp_path / name, text.format(row="\t-1  4 5e0 +6.5 \r\n"))
    expected = [[1, 2, 3], [4, 5, 6.5], [7, 8, 9]]
    np.testing.assert_array_equal(dataset.read_scan(path)[0], expected)


@pytest.mark.parametrize(("name", "text", "line"), ASCII)
@pytest.mark.parametrize(
    ("row", "expected"),
    [
        ("0 4 abc 6", ", column y: 'abc' is not a number."),
        ("0 4 5 6_0", ", column z: '6_0' is not a number."),
        ("abc 4 5 6", ", column intensity: 'abc' is not a number."),
        ("0 4 5", ": 3 columns, expected 4."),
        ("0 4 5 6 7", ": 5 columns, expected 4."),
    ],
)
def test_ascii_row_that_does_not_fit(tmp_path, name, text, line, row, expected):
    path = written(tmp_path / name, text.format(row=row))
    assert "get or export it again" in problem(path, f", line {line}{expected}")


@pytest.mark.parametrize(("name", "text", "line"), ASCII)
def test_ascii_rows_that_are_not_finite_are_counted(tmp_path, name, text, line):
    path = written(tmp_path / name, text.format(row="0 4 nan 6"))
    problem(path, ": 1 of 3 rows are not finite (NaN or infinite x, y or z), the first is row 2")
    points, dropped = dataset.read_scan(path, drop_non_finite=True)
    assert points.tolist() == [[1, 2, 3], [7, 8, 9]] and dropped == 1


@pytest.mark.parametrize(
    ("name", "text", "old", "new"),
    [
        ("a.ply", PLY, "float x\nproperty float y", "float X\nproperty float Y"),
        ("a.ply", PLY.replace("ascii", "binary_little_endian"), "float x\nproperty float y",
         "float X\nproperty float Y"),
        ("a.pcd", PCD, "intensity x y z", "intensity X Y z"),
    ],
)  # fmt: skip
def test_point_cloud_without_the_columns(tmp_path, name, text, old, new):
    path = written(tmp_path / name, text.replace(old, new).format(row="0 4 5 6"))
    message = problem(path, ": no column x, y in the header; its columns are intensity, X, Y, z.")
    assert "needs the columns x, y and z, in lower case" in message


def test_point_cloud_of_no_points(tmp_path):
    text = PCD.replace("POINTS 3", "POINTS 0").replace("WIDTH 3", "WIDTH 0")
    problem(written(tmp_path / "a.pcd", text[: text.index("0 1 2 3")]), ": no points.")


@pytest.mark.parametrize("text", ["", "\n", "1,2,3\n4,5,6\n", "x;y;z\n1;2;3\n", "X,Y,Z\n1,2,3\n"])
def test_csv_without_the_columns(tmp_path, text):
    path = written(tmp_path / "a.csv", text)
    problem(path, ", line 1: expected a header with the columns x, y and z, each once")


def test_csv_with_a_column_twice(tmp_path):
    message = problem(written(tmp_path / "a.csv", "x,y,x,z\n1,2,3,4\n"), ", line 1: ")
    assert "found 'x,y,x,z'" in message


def test_csv_with_a_header_only(tmp_path):
    problem(written(tmp_path / "a.csv", "x,y,z\n"), ": no points.")


def test_csv_cut_off_in_its_last_line(tmp_path):
    text = scan_csv(POINTS)
    path = written(tmp_path / "a.csv", text[: text.rindex(",-1,0")])
    assert "cut off" in problem(path, ", line 1201: 4 columns, expected 7.")


@pytest.mark.parametrize("cell", ["abc", "", "1_0", "0x10", "1,5"])
def test_csv_with_a_cell_that_is_no_number(tmp_path, cell):
    path = written(tmp_path / "a.csv", f"x,y,z\n1,2,3\n4,{cell},6\n")
    if "," in cell:
        problem(path, ", line 3: 4 columns, expected 3.")
    else:
        problem(path, f", line 3, column y: {cell!r} is not a number.")


def test_non_finite_rows_are_counted(tmp_path):
    points = POINTS.copy()
    points[3, 1], points[7, 2] = np.nan, np.inf
    path = written(tmp_path / "a.csv", scan_csv(points))
    message = problem(path, ": 2 of 1200 rows are not finite")
    assert "first is row 4" in message and "`drop_non_finite: true`" in message
    kept, dropped = dataset.read_scan(path, drop_non_finite=True)
    assert dropped == 2
    np.testing.assert_array_equal(kept, np.delete(POINTS, [3, 7], axis=0))


def test_too_few_points_after_the_range_filter():
    near = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    points = np.concatenate([0.999 * near[:300], 1.001 * near[300:]])
    with pytest.raises(
        DataError, match=r"apartment, scan 3: 900 of 1200 points are farther than 1"
    ):
        dataset.check_scan(points, 1.0, "apartment, scan 3")
    dataset.check_scan(points, 0.5, "apartment, scan 3")


def test_unknown_scan_format(tmp_path):
    problem(tmp_path / "a.las", ": no scan format of this name.")


# Poses


def test_data_set_poses(tmp_path):
    path = written(tmp_path / "p.csv", poses_csv(POSES))
    np.testing.assert_array_equal(dataset.read_poses(path, 4), POSES)


@pytest.mark.parametrize("width", [12, 16])
@pytest.mark.parametrize("separator", [" ", ","])
def test_kitti_poses(tmp_path, width, separator):
    path = tmp_path / "poses.txt"
    np.savetxt(path, POSES.reshape(4, 16)[:, :width], fmt="%.17g", delimiter=separator)
    np.testing.assert_array_equal(dataset.read_poses(path, 4), POSES)


def test_tum_poses(tmp_path):
    quaternions = Rotation.from_matrix(POSES[:, :3, :3]).as_quat()  # x y z w
    rows = np.column_stack([np.arange(4) / 10, POSES[:, :3, 3], quaternions])
    path = tmp_path / "poses.tum"
    np.savetxt(path, rows, header="timestamp tx ty tz qx qy qz qw", fmt="%.17g")
    np.testing.assert_allclose(dataset.read_poses(path, 4), POSES, atol=1e-14)
    np.savetxt(path, rows, fmt="%.4f")  # the format's habit
    np.testing.assert_allclose(dataset.read_poses(path, 4), POSES, atol=3e-4)


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
        dataset.read_poses(path, 2)
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
        dataset.read_poses(path, 4)
    assert str(error.value).startswith(f"{path}{expected}"), error.value


def test_pose_count_names_the_line_to_change(tmp_path):
    path = written(tmp_path / "p.csv", poses_csv(POSES))
    with pytest.raises(DataError, match=r"change `scans: 45` to `scans: 4`"):
        dataset.read_poses(path, 45)


def test_a_single_pose_is_no_reason_to_ask_for_a_single_scan(tmp_path):
    path = written(tmp_path / "p.txt", IDENTITY)
    with pytest.raises(DataError, match=r"1 poses, but .*`scans: 2`") as error:
        dataset.read_poses(path, 2)
    assert "and at least 2 scans; the file may be cut off" in str(error.value)
    assert "`scans: 1`" not in str(error.value)


def test_rotations_are_accepted_up_to_the_tolerance(tmp_path):
    path = written(tmp_path / "p.txt", f"1.00004{IDENTITY[1:]}\n")
    assert dataset.read_poses(path, 1)[0, 0, 0] == 1.00004  # read, not corrected
    path = written(tmp_path / "p.txt", f"1.00006{IDENTITY[1:]}\n")
    with pytest.raises(DataError, match="not a rotation"):
        dataset.read_poses(path, 1)


# Folders


@pytest.mark.parametrize("place", dataset.LEICA_PLACES)
def test_data_set_folder(tmp_path, place):
    write_folder(tmp_path, [POINTS[:3]] * 12, POSES, place)
    paths, poses = dataset.find_folder_files(tmp_path, 12)
    assert [path.name for path in paths] == [f"Hokuyo_{index}.csv" for index in range(12)]
    assert poses == tmp_path / place / "pose_scanner_leica.csv"


def own_folder(folder, *names):
    for name in names:
        (folder / name).touch()
    return folder


def test_own_folder_in_natural_order(tmp_path):
    own_folder(tmp_path, "scan_10.ply", "scan_9.ply", "scan_1.PLY", "poses.txt", "readme.txt")
    own_folder(tmp_path, "._scan_9.ply", ".DS_Store")
    paths, poses = dataset.find_folder_files(tmp_path, 3)
    assert [path.name for path in paths] == ["scan_1.PLY", "scan_9.ply", "scan_10.ply"]
    assert poses.name == "poses.txt"


@pytest.mark.parametrize(
    "name", ["poses.csv", "pose_scanner_leica.csv", "trajectory.tum", "gt.txt"]
)
def test_pose_file_beside_csv_scans(tmp_path, name):
    paths, poses = dataset.find_folder_files(own_folder(tmp_path, "1.csv", "2.csv", name), 2)
    assert [path.name for path in paths] == ["1.csv", "2.csv"] and poses.name == name


def test_pose_file_can_be_named(tmp_path):
    own_folder(tmp_path, "1.csv", "2.csv", "truth.csv", "poses.txt")
    paths, poses = dataset.find_folder_files(tmp_path, 2, "truth.csv")
    assert [path.name for path in paths] == ["1.csv", "2.csv"] and poses.name == "truth.csv"


@pytest.mark.parametrize(
    ("names", "options", "expected"),
    [
        (["1.ply"], {}, "expected one pose file .*found none"),
        (["1.ply", "a.txt", "b.txt"], {}, r"expected one pose file .*found a\.txt, b\.txt"),
        (["1.ply", "poses.txt"], {"pose_file": "p.txt"}, r"p\.txt: no such pose file"),
        (["1.ply", "2.pcd", "poses.txt"], {}, r"scans of different kinds \(\.pcd, \.ply\)"),
        (["1.ply", "poses.txt"], {}, r"1 scans \(\.ply\), but the configuration says `scans: 2`"),
        (["poses.txt"], {}, r"0 scans \(\.csv, \.ply, \.pcd\), but"),
    ],
)
def test_incomplete_folders(tmp_path, names, options, expected):
    with pytest.raises(DataError, match=expected) as error:
        dataset.find_folder_files(own_folder(tmp_path, *names), 2, **options)
    assert "\nHint: " in str(error.value)


def test_incomplete_data_set_folder(tmp_path):
    write_folder(tmp_path, [POINTS[:3]] * 5, POSES)
    (tmp_path / "csv_local/Hokuyo_3.csv").unlink()
    with pytest.raises(DataError, match=r"4 files .*`scans: 5`.*missing: Hokuyo_3.csv"):
        dataset.find_folder_files(tmp_path, 5)
    (tmp_path / "leica/pose_scanner_leica.csv").unlink()
    with pytest.raises(DataError, match=r"no pose_scanner_leica.csv in leica/, csv_global/, csv_l"):
        dataset.find_folder_files(tmp_path, 5)


@pytest.mark.parametrize(
    ("numbers", "scans", "hint"),
    [
        ([0, 1, 2, 4], 4, "number the files, and their poses, from 0 without gaps."),
        ([0, 1, 2, 4], 5, "number the files, and their poses, from 0 without gaps."),
        ([0, 1, 2], 4, "complete the folder, or set `scans: 3` if these are all."),
        ([0], 2, "complete the folder; at least 2 scans are needed."),
    ],
)
def test_hint_for_scans_that_do_not_count_up(tmp_path, numbers, scans, hint):
    (tmp_path / "leica").mkdir()
    (tmp_path / "csv_local").mkdir()
    own_folder(tmp_path / "leica", dataset.LEICA_NAME)
    own_folder(tmp_path / "csv_local", *(f"Hokuyo_{number}.csv" for number in numbers))
    with pytest.raises(DataError) as error:
        dataset.find_folder_files(tmp_path, scans)
    assert f": {len(numbers)} files" in str(error.value) and str(error.value).endswith(hint)


def test_hint_for_own_scans(tmp_path):
    own_folder(tmp_path, "1.ply", "poses.txt")
    with pytest.raises(DataError, match=r"Hint: complete the folder; at least 2 scans are needed"):
        dataset.find_folder_files(tmp_path, 2)
    own_folder(tmp_path, "2.ply")
    with pytest.raises(DataError, match=r"Hint: .*set `scans: 2` if these are all"):
        dataset.find_folder_files(tmp_path, 3)


def test_missing_folder(tmp_path):
    with pytest.raises(DataError, match="nowhere: no such folder"):
        dataset.find_folder_files(tmp_path / "nowhere", 5)


# Ground truth


@pytest.fixture(scope="module")
def room_pair():
    """Two scans of a 6 m x 4 m x 3 m box of 20,000 points, and of the robot, which moves along."""
    generator = np.random.default_rng(3)
    size = np.array([6.0, 4.0, 3.0])
    walls = generator.uniform(0, size, (20_000, 3))
    axis = generator.integers(0, 3, len(walls))
    walls[np.arange(len(walls)), axis] = (
        generator.integers(0, 2, len(walls)) * size[axis]
    ).tolist()
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
    distance, warning = dataset.ground_truth_distance(*room_pair, minimum_range=1.0)
    assert 0.005 < distance < 0.05 and warning == ""


def test_distance_is_the_median_over_the_points_beyond_the_range():
    reference = np.array([[10.0, 0, 0], [20, 0, 0], [30, 0, 0], [0.1, 0, 0]])
    source = np.array([[10.01, 0, 0], [20, 0.02, 0], [30, 0, 0.03], [0.1, 0, 0], [0, 0.1, 0]])
    distance, _ = dataset.ground_truth_distance(reference, source, np.eye(4), 1.0)
    assert distance == pytest.approx(0.02)


def test_wrong_ground_truth_is_noticed(room_pair):
    reference, source, T = room_pair
    _, warning = dataset.ground_truth_distance(reference, source, se3.inverse(T), 1.0)
    assert "the ground truth looks wrong: with no motion at all" in warning and "Hint" in warning
    small = T @ se3.exp([0, 0, 0.01, 0, 0, 0])
    assert dataset.ground_truth_distance(reference, source, small, 1.0)[1] == ""
    far = T.copy()
    far[2, 3] += 50.0
    distance, warning = dataset.ground_truth_distance(reference, source, far, 1.0)
    assert distance > 40 and "looks wrong" in warning


def test_scans_that_hardly_overlap_are_noticed(room_pair):
    reference, _, _ = room_pair
    away = reference + np.array([100.0, 0, 0])
    distance, warning = dataset.ground_truth_distance(reference, away, np.eye(4), 1.0)
    assert distance > 90 and "hardly overlap" in warning


def test_real_pair():
    folder = os.environ.get("ICPSHAP_REAL_DATA")
    if not folder:
        pytest.skip("set ICPSHAP_REAL_DATA to the folder that holds apartment_pair/")
    paths, pose_path = dataset.find_folder_files(Path(folder) / "apartment_pair", 2)
    T = dataset.read_poses(pose_path, 2)
    reference, source = (dataset.read_scan(path)[0] for path in paths)
    assert (len(reference), len(source)) == (36_674, 36_670)
    T_reference_source = se3.inverse(T[0]) @ T[1]
    distance, warning = dataset.ground_truth_distance(reference, source, T_reference_source, 1.0)
    assert distance == pytest.approx(0.032, abs=0.002) and warning == ""
    T_wrong = se3.inverse(T_reference_source)
    assert dataset.ground_truth_distance(reference, source, T_wrong, 1.0)[1]
