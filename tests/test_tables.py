"""Parquet files: columns, units, bytes."""

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from icpshap import tables
from icpshap.causes import CAUSES, named

POINTS = np.arange(30.0).reshape(10, 3)


def test_points_and_poses_come_back(tmp_path):
    tables.write_scans(tmp_path / "scans.parquet", [(3, POINTS, None, 0)], {})
    np.testing.assert_array_equal(tables.read_scan(tmp_path / "scans.parquet", 3)[0], POINTS)
    poses = np.arange(32.0).reshape(2, 4, 4)
    tables.write(tmp_path / "poses.parquet", tables.poses_frame(poses), "poses")
    np.testing.assert_array_equal(tables.read_poses(tmp_path / "poses.parquet"), poses)


def test_units_and_what_decided_the_numbers_are_in_the_file(tmp_path):
    path = tmp_path / "scans.parquet"
    tables.write_scans(path, [(3, POINTS, None, 0)], {"seed": 4})
    assert pq.read_schema(path).field("x").metadata[b"unit"] == b"m"
    about = tables.read_about(path)
    assert (about["table"], about["plan"]) == ("scans", {"seed": 4})


def test_same_frame_same_bytes_and_no_partial_file(tmp_path):
    for name in ("a", "b"):
        tables.write_scans(tmp_path / name, [(3, POINTS, None, 0)], {"seed": 4})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


def test_a_frame_with_other_columns_is_refused(tmp_path):
    frame = pd.DataFrame({"scan": [1], "x": [1.0], "y": [1.0], "w": [1.0]})
    with pytest.raises(tables.TableError, match=r"missing \['z'\], unknown \['w'\]"):
        tables.write(tmp_path / "scan.parquet", frame, "scans")
    assert not list(tmp_path.iterdir())


def test_a_file_of_another_table_is_refused(tmp_path):
    path = tmp_path / "scan.parquet"
    tables.write_scans(path, [(3, POINTS, None, 0)], {})
    with pytest.raises(tables.TableError, match=r"not a runs table[\s\S]*Hint"):
        tables.read(path, "runs")


@pytest.mark.parametrize("names", [(), ("sensor_noise",), tuple(CAUSES)])
@pytest.mark.parametrize("table", tables.TABLES)
def test_an_empty_table_has_its_columns(tmp_path, table, names):
    path = tmp_path / "empty.parquet"
    tables.write(path, tables.empty(table, names), table, causes=names)
    frame = tables.read(path, table)
    assert list(frame.columns) == [column.name for column in tables.columns(table, named(names))]
    assert len(frame) == 0


def test_columns_follow_from_the_causes_that_are_named():
    of_two = [c.name for c in tables.columns("shap", named(["sensor_noise", "partial_overlap"]))]
    assert "phi_sensor_noise" in of_two
    assert "interaction_sensor_noise_partial_overlap" in of_two
    assert not [name for name in of_two if "initial_pose" in name]


def test_the_file_says_whose_columns_it_has(tmp_path):
    path = tmp_path / "runs.parquet"
    backwards = ("partial_overlap", "sensor_noise")
    tables.write(path, tables.empty("runs", backwards), "runs", {"seed": 4}, backwards)
    assert tables.read_about(path)["causes"] == ["sensor_noise", "partial_overlap"]


def test_a_file_of_a_cause_that_is_gone_is_named(tmp_path, monkeypatch):
    path = tmp_path / "runs.parquet"
    tables.write(path, tables.empty("runs", ["sensor_noise"]), "runs", causes=["sensor_noise"])
    monkeypatch.delitem(CAUSES, "sensor_noise")
    with pytest.raises(tables.TableError, match=r"runs.parquet: .*causes sensor_noise.*\nHint"):
        tables.read(path, "runs")


def test_the_unit_of_a_level_is_that_of_the_variant(tmp_path):
    variants = {"sensor_noise": {"sensor": "hokuyo_utm_30lx"}}
    for plan, unit in (({"seed": 1}, b"m"), ({"variants": variants}, b"")):
        path = tmp_path / "runs.parquet"
        runs = tables.empty("runs", ["sensor_noise"])
        tables.write(path, runs, "runs", plan, ["sensor_noise"])
        assert pq.read_schema(path).field("sensor_noise").metadata[b"unit"] == unit
        assert len(tables.read(path, "runs")) == 0


def test_the_rows_of_a_pair_are_found_in_the_files_of_its_jobs(tmp_path, monkeypatch):
    """A pair may have several jobs, and a job several pairs; each file is read once, in order."""
    known = tables.columns("runs", named(["sensor_noise"]))
    zeros = {column.name: "" if column.type == "string" else 0 for column in known}
    jobs = [[(0, 1)], [(0, 1), (1, 2), (2, 3)], [(3, 4)]]
    paths = [tmp_path / f"{job}.parquet" for job in range(len(jobs))]
    for job, (path, pairs) in enumerate(zip(paths, jobs, strict=True)):
        # Of the pair 2-3, which was not registered, there are no rows.
        rows = [{**zeros, "run": job, "reference": a, "source": b} for a, b in pairs if a != 2]
        plan = {"parts": [[list(pair), 0, 1] for pair in pairs]}
        tables.write(path, pd.DataFrame(rows), "runs", plan, ["sensor_noise"])
    read = []

    def noted(path, table, read_table=tables.read):
        read.append(path)
        return read_table(path, table)

    monkeypatch.setattr(tables, "read", noted)
    runs = tables.ByPair(paths, "runs")
    found = {pair: runs.get(pair) for pair in [(0, 1), (1, 2), (2, 3), (3, 4), (7, 8)]}
    assert [None if rows is None else rows["run"].tolist() for rows in found.values()] == [
        *([0, 1], [1], None, [2], None),
    ]
    assert read == paths
    assert tables.ByPair([], "runs").get((0, 1)) is None
