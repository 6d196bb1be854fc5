"""Scans of every format, whole and damaged, and what a scan must have."""

import numpy as np
import pytest
from known_files import POINTS, written
from misbehaving_server import scan_csv

from icpshap.data.open3d_loader import load_open3d
from icpshap.data.scans import check_scan, read_scan
from icpshap.errors import DataError


def problem(path, expected, **options):
    """The whole message of the error of reading a scan; its beginning is checked."""
    with pytest.raises(DataError) as error:
        read_scan(path, **options)
    message = str(error.value)
    assert message.startswith(f"{path}{expected}"), message
    assert "\nHint: " in message
    return message


def test_hokuyo_scan_is_read_to_the_last_digit(tmp_path):
    path = written(tmp_path / "Hokuyo_0.csv", scan_csv(POINTS))
    points, dropped = read_scan(path)
    np.testing.assert_array_equal(points, POINTS)
    assert points.dtype == float and dropped == 0


def test_own_csv_is_read_by_column_names(tmp_path):
    text = "\ufeffz, intensity, x, y\r\n3,,1,2\r\n6,bright, 4 ,5e0\r\n"
    path = tmp_path / "own.csv"
    path.write_bytes(text.encode())
    np.testing.assert_array_equal(read_scan(path)[0], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize("suffix", [".ply", ".pcd"])
@pytest.mark.parametrize("options", [{"write_ascii": True}, {}, {"compressed": True}])
def test_ply_and_pcd(tmp_path, suffix, options):
    path = write_cloud(tmp_path / f"scan{suffix}", POINTS, **options)
    np.testing.assert_allclose(read_scan(path)[0], POINTS, atol=5e-5, rtol=0)  # ASCII: 6 digits


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
    np.testing.assert_array_equal(read_scan(path)[0], expected)


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
    points, dropped = read_scan(path, drop_non_finite=True)
    assert points.tolist() == [[1, 2, 3], [7, 8, 9]] and dropped == 1


@pytest.mark.parametrize(
    ("name", "text", "old", "new"),
    [
        ("a.ply", PLY, "float x\nproperty float y", "float u\nproperty float v"),
        ("a.ply", PLY.replace("ascii", "binary_little_endian"), "float x\nproperty float y",
         "float u\nproperty float v"),
        ("a.pcd", PCD, "intensity x y z", "intensity u v z"),
    ],
)  # fmt: skip
def test_point_cloud_without_the_columns(tmp_path, name, text, old, new):
    path = written(tmp_path / name, text.replace(old, new).format(row="0 4 5 6"))
    message = problem(path, ": no column x, y in the header; its columns are intensity, u, v, z.")
    assert "needs the columns x, y and z" in message


def test_point_cloud_of_no_points(tmp_path):
    text = PCD.replace("POINTS 3", "POINTS 0").replace("WIDTH 3", "WIDTH 0")
    problem(written(tmp_path / "a.pcd", text[: text.index("0 1 2 3")]), ": no points.")


@pytest.mark.parametrize(
    "text", ["", "\n", "1,2\n4,5\n", "x;y;r\n1;2;3\n", "x [mm],y [mm],z [mm]\n1,2,3\n"]
)
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
    kept, dropped = read_scan(path, drop_non_finite=True)
    assert dropped == 2
    np.testing.assert_array_equal(kept, np.delete(POINTS, [3, 7], axis=0))


def test_too_few_points_after_the_range_filter():
    near = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    points = np.concatenate([0.999 * near[:300], 1.001 * near[300:]])
    with pytest.raises(
        DataError, match=r"apartment, scan 3: 900 of 1200 points are farther than 1"
    ):
        check_scan(points, 1.0, "apartment, scan 3")
    check_scan(points, 0.5, "apartment, scan 3")


def test_unknown_scan_format(tmp_path):
    problem(tmp_path / "a.las", ": no scan format of this name.")
