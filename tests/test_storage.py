"""Parquet files that say when they are not what was written."""

import errno
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from icpshap import storage, tables
from icpshap.errors import UserError
from icpshap.storage import StorageError

ABOUT = {"table": "poses", "plan": {"seed": 4}, "truth": "none"}
POINTS = np.random.default_rng(0).normal(size=(40, 3))
SCANS = [(9, POINTS, None, 0), (10, POINTS[:7], None, 2)]


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "scan.parquet"
    poses = np.random.default_rng(0).normal(size=(40, 4, 4))
    tables.write(path, tables.poses_frame(poses), "poses", {"seed": 4}, truth="none")
    return path


@pytest.fixture
def in_parts(tmp_path):
    path = tmp_path / "scans.parquet"
    tables.write_scans(path, SCANS, {"seed": 4})
    return path


def test_what_was_written_comes_back(path):
    table, about = storage.read(path)
    assert about == ABOUT
    assert table.num_rows == 40


def test_missing_values_and_text_come_back(tmp_path):
    table = pa.table(
        {
            "x": [1.0, None, float("nan")],
            "status": ["ok", "", "größer"],
            "right": [True, False, True],
        }
    )
    storage.write(tmp_path / "a.parquet", table, {})
    found, _ = storage.read(tmp_path / "a.parquet")
    assert found.to_pylist()[0] == {"x": 1.0, "status": "ok", "right": True}


@pytest.mark.parametrize("kind", ["path", "in_parts"])
@pytest.mark.parametrize("seed", range(40))
def test_one_flipped_bit_is_never_read_in_silence(request, kind, seed):
    """Neither of values nor of the footer: an error that names the file, or the same table."""
    path = request.getfixturevalue(kind)
    whole = path.read_bytes()
    expected = storage.read(path)
    generator = np.random.default_rng(seed)
    for position in generator.integers(len(whole), size=30):
        damaged = bytearray(whole)
        damaged[position] ^= 1 << generator.integers(8)
        path.write_bytes(damaged)
        try:
            table, about = storage.read(path)
        except StorageError as error:
            assert str(path) in str(error) and "Hint" in str(error)
        else:
            assert table.equals(expected[0], check_metadata=True) and about == expected[1]


@pytest.mark.parametrize("length", [0, 1, 100, 127, 128, 20_000, 100_000])
def test_what_decided_a_file_is_found_in_its_end(tmp_path, length, monkeypatch):
    about = {"plan": "x" * length}
    path = tmp_path / "a.parquet"
    storage.write(path, pa.table({"x": [1.0]}), about)
    assert storage.read_about(path) == about
    if length < 40_000:  # of a longer one Arrow has to be asked
        monkeypatch.setattr(storage.pq, "read_metadata", None)
        assert storage.read_about(path) == about


def test_a_flipped_bit_of_what_decided_a_file_is_never_read_in_silence(path):
    """Who only asks for it reads nothing else. It is stored twice, in the clear and in base 64."""
    whole = path.read_bytes()
    footer = len(whole) - 8 - int.from_bytes(whole[-8:-4], "little")
    named = 0
    for position in range(footer, len(whole)):
        damaged = bytearray(whole)
        damaged[position] ^= 1
        path.write_bytes(damaged)
        try:
            assert storage.read_about(path) == ABOUT
        except StorageError as error:
            assert str(path) in str(error)
            named += "digest that was written with it" in str(error)
    assert named > len(json.dumps(ABOUT))


@pytest.mark.parametrize("length", [0, 3, 4, 100, -1, -4])
def test_a_file_that_is_cut_off_is_named(path, length):
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(StorageError, match=r"scan.parquet: the file is damaged[\s\S]*Hint: remove"):
        storage.read(path)


def test_garbage_and_other_programs_files_are_named(path):
    path.write_bytes(b"PAR1" + bytes(1000) + b"PAR1")
    with pytest.raises(StorageError, match=r"scan\.parquet"):
        storage.read(path)
    pq.write_table(pa.table({"x": [1.0]}), path)
    with pytest.raises(StorageError, match="none of the metadata that are written"):
        storage.read(path)


def test_a_disk_without_room_is_named_and_the_old_file_stays(path, monkeypatch):
    def no_room(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    table, about = storage.read(path)
    monkeypatch.setattr(storage.os, "fsync", no_room)
    with pytest.raises(
        StorageError, match=r"scan\.parquet: cannot be written: No space left.*\nHint"
    ):
        storage.write(path, table.slice(0, 1), about)
    assert storage.read(path)[0].equals(table)
    assert [found.name for found in path.parent.iterdir()] == [path.name]


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(StorageError, match=r"nothing.parquet: no such file.\nHint"):
        storage.read(tmp_path / "nothing.parquet")
    with pytest.raises(StorageError, match=r"nothing.parquet"):
        storage.read_about(tmp_path / "nothing.parquet")


def test_a_table_without_rows_has_a_digest_too(tmp_path):
    path = tmp_path / "empty.parquet"
    tables.write(path, tables.empty("runs", ["sensor_noise"]), "runs", causes=["sensor_noise"])
    assert len(tables.read(path, "runs")) == 0


def test_parts_come_back_one_by_one_and_together(in_parts):
    for index, points, *_ in SCANS:
        np.testing.assert_array_equal(tables.read_scan(in_parts, index)[0], points)
    together = tables.read(in_parts, "scans")
    np.testing.assert_array_equal(together[["x", "y", "z"]], np.concatenate([POINTS, POINTS[:7]]))
    assert together["scan"].tolist() == [9] * 40 + [10] * 7
    parts = storage.parts_of([in_parts])
    assert list(parts) == ["scan_10", "scan_9"] and parts["scan_10"][1]["dropped_rows"] == 2
    with pytest.raises(StorageError, match=r"scans.parquet: .*it has no part scan_8"):
        tables.read_scan(in_parts, 8)


def test_the_digest_of_a_part_is_that_of_its_values_alone(in_parts, tmp_path):
    other = tmp_path / "other.parquet"
    tables.write_scans(other, [(8, POINTS[:3], None, 0), SCANS[1]], {"seed": 5})
    digests = [storage.parts_of([path])["scan_10"][1]["digest"] for path in (in_parts, other)]
    assert digests[0] == digests[1]


def test_a_part_that_fails_leaves_no_file(tmp_path):
    def scans():
        yield SCANS[0]
        raise UserError("a bad scan")

    with pytest.raises(UserError, match="a bad scan"):
        tables.write_scans(tmp_path / "scans.parquet", scans(), {})
    assert not list(tmp_path.iterdir())


def test_rows_are_counted_without_reading_them(in_parts):
    assert storage.largest_part(in_parts) == 40
    in_parts.write_bytes(b"damaged")
    assert storage.largest_part(in_parts) == 0
    in_parts.unlink()
    # Snakemake takes the name as the sign of a file that is yet to be made.
    with pytest.raises(FileNotFoundError) as error:
        storage.largest_part(in_parts)
    assert error.value.filename == str(in_parts)
