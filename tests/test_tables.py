"""Parquet files: columns, units, bytes."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from icpshap import tables

POINTS = np.arange(30.0).reshape(10, 3)


def test_points_and_poses_come_back(tmp_path):
    tables.write(tmp_path / "scan.parquet", tables.points_frame(POINTS), "scan")
    np.testing.assert_array_equal(tables.read_points(tmp_path / "scan.parquet"), POINTS)
    poses = np.arange(32.0).reshape(2, 4, 4)
    tables.write(tmp_path / "poses.parquet", tables.poses_frame(poses), "poses")
    np.testing.assert_array_equal(tables.read_poses(tmp_path / "poses.parquet"), poses)


def test_units_and_what_decided_the_numbers_are_in_the_file(tmp_path):
    path = tmp_path / "scan.parquet"
    tables.write(path, tables.points_frame(POINTS), "scan", {"seed": 4})
    assert pq.read_schema(path).field("x").metadata[b"unit"] == b"m"
    assert tables.read_metadata(path) == {"table": "scan", "seed": 4}


def test_same_frame_same_bytes_and_no_partial_file(tmp_path):
    for name in ("a", "b"):
        tables.write(tmp_path / name, tables.points_frame(POINTS), "scan", {"seed": 4})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_frame_with_other_columns_is_refused(tmp_path):
    frame = pd.DataFrame({"x": [1.0], "y": [1.0], "w": [1.0]})
    with pytest.raises(tables.TableError, match=r"missing \['z'\], unknown \['w'\]"):
        tables.write(tmp_path / "scan.parquet", frame, "scan")
    assert not list(tmp_path.iterdir())


def test_a_file_of_another_table_is_refused(tmp_path):
    path = tmp_path / "scan.parquet"
    tables.write(path, tables.points_frame(POINTS), "scan")
    with pytest.raises(tables.TableError, match=r"not a runs table[\s\S]*Hint"):
        tables.read(path, "runs")


@pytest.mark.parametrize("table", tables.TABLES)
def test_an_empty_table_has_its_columns(tmp_path, table):
    tables.write(tmp_path / "empty.parquet", tables.empty(table), table)
    frame = tables.read(tmp_path / "empty.parquet", table)
    assert list(frame.columns) == [column.name for column in tables.TABLES[table]]
    assert len(frame) == 0
