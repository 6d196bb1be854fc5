"""Parquet files that say when they are not what was written."""

import errno
import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from icpshap import storage, tables
from icpshap.storage import StorageError

ABOUT = {"table": "scan", "plan": {"seed": 4}, "dropped_rows": 3}


@pytest.fixture
def path(tmp_path):
    generator = np.random.default_rng(0)
    path = tmp_path / "scan.parquet"
    tables.write(
        path,
        tables.points_frame(generator.normal(size=(40, 3))),
        "scan",
        {"seed": 4},
        dropped_rows=3,
    )
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


@pytest.mark.parametrize("seed", range(40))
def test_one_flipped_bit_is_never_read_in_silence(path, seed):
    """Neither of values nor of the footer: an error that names the file, or the same table."""
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


def test_rows_are_counted_without_reading_them(path):
    assert storage.number_of_rows(path) == 40
    path.write_bytes(b"damaged")
    assert storage.number_of_rows(path) == 0
    path.unlink()
    # Snakemake takes the name as the sign of a file that is yet to be made.
    with pytest.raises(FileNotFoundError) as error:
        storage.number_of_rows(path)
    assert error.value.filename == str(path)
