"""When each point was measured: read from a column of any format, or said what is wrong with it."""

import numpy as np
import pandas as pd
import pytest
from known_files import POINTS, written

from icpshap import tables
from icpshap.data.open3d_loader import load_open3d
from icpshap.data.scans import read_scan, read_timed_scan
from icpshap.errors import DataError

TIMES = np.random.default_rng(6).permutation(np.linspace(3.0, 4.0, len(POINTS)))
FORMATS = [
    ("a.csv", {}),
    ("a.ply", {"write_ascii": True}),
    ("a.ply", {}),
    ("a.pcd", {"write_ascii": True}),
    ("a.pcd", {}),
    ("a.pcd", {"compressed": True}),
]


def timed(path, points=POINTS, times=TIMES, **options):
    """A scan file with the times in a column `stamp`."""
    if path.suffix == ".csv":
        frame = pd.DataFrame(points, columns=list("xyz"))
        frame.insert(1, "stamp", times)
        frame.to_csv(path, index=False)
        return path
    open3d = load_open3d()
    cloud = open3d.t.geometry.PointCloud(open3d.core.Tensor(points))
    cloud.point["stamp"] = open3d.core.Tensor(times[:, None])
    assert open3d.t.io.write_point_cloud(str(path), cloud, **options)
    return path


def problem(path, time="stamp", **options):
    with pytest.raises(DataError) as caught:
        read_timed_scan(path, time, **options)
    return str(caught.value)


@pytest.mark.parametrize(("name", "options"), FORMATS)
def test_times_are_read_beside_the_points(tmp_path, name, options):
    path = timed(tmp_path / name, **options)
    points, times, dropped = read_timed_scan(path, "stamp")
    np.testing.assert_allclose(times, TIMES, atol=1e-5)
    np.testing.assert_allclose(points, POINTS, atol=5e-5)
    assert dropped == 0 and read_timed_scan(path, None)[1] is None
    np.testing.assert_array_equal(read_scan(path)[0], points)


@pytest.mark.parametrize(("name", "options"), FORMATS)
def test_a_column_that_is_missing_is_named_with_those_there_are(tmp_path, name, options):
    path = timed(tmp_path / name, **options)
    message = problem(path, "t")
    assert message.startswith(f"{path}: expected one column 't' with the times of the points, ")
    assert "found none; its columns are" in message and "stamp" in message
    assert "\nHint: set `time` of the sequence to the name of the column" in message


def test_times_that_are_not_finite_are_counted(tmp_path):
    times = TIMES.copy()
    times[[4, 9]] = np.nan, np.inf
    path = timed(tmp_path / "a.csv", times=np.array(list(map(repr, times.tolist()))))
    message = problem(path)
    assert "2 of 1200 rows are not finite (NaN or infinite x, y, z or stamp), the first" in message
    assert "is row 5 of the points" in message
    points, kept, dropped = read_timed_scan(path, "stamp", drop_non_finite=True)
    assert dropped == 2 and len(points) == len(kept) == 1198
    assert read_scan(path)[1] == 0  # without times these rows are good


def test_times_that_are_all_the_same_are_refused(tmp_path):
    path = timed(tmp_path / "a.csv", times=np.full(len(POINTS), 7.0))
    message = problem(path)
    assert message.startswith(f"{path}: all 1200 values in the column stamp are 7, expected the")
    assert "\nHint: set `time` of the sequence to another column, or leave it out" in message


def test_a_time_that_is_no_number_is_named_with_its_line(tmp_path):
    path = written(tmp_path / "a.csv", "x,y,z,stamp\n1,2,3,0.1\n4,5,6,noon\n")
    assert f"{path}, line 3, column stamp: 'noon' is not a number." in problem(path)


def test_a_format_without_times_is_told(tmp_path, monkeypatch):
    from icpshap.data import scans

    monkeypatch.setattr(scans, "SCAN_SUFFIXES", (*scans.SCAN_SUFFIXES, ".asc"))
    message = problem(written(tmp_path / "a.asc", "1 2 3\n"))
    assert ".asc files are read without times, expected a format that has a column stamp" in message


def test_a_table_holds_them_where_the_scan_has_them(tmp_path):
    tables.write_scans(tmp_path / "timed", [(1, POINTS, TIMES, 0)], {"time": "stamp"})
    tables.write_scans(tmp_path / "plain", [(1, POINTS, None, 0)], {})
    for name, expected in (("timed", TIMES), ("plain", None)):
        points, times = tables.read_scan(tmp_path / name, 1)
        np.testing.assert_array_equal(points, POINTS)
        np.testing.assert_array_equal(times, expected)
