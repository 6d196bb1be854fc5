import hashlib
import io
import logging
import random
import runpy
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from misbehaving_server import (
    MisbehavingServer,
    build_archive,
    poses_csv,
    scan_csv,
    write_folder,
)

from icpshap import se3
from icpshap.data import citation, remote_file
from icpshap.data.archive import open_archive, open_sequence
from icpshap.data.folder import find_folder_files
from icpshap.data.layout import LEICA_PLACES
from icpshap.data.poses import read_poses
from icpshap.data.scans import read_scan
from icpshap.errors import DataError

SCANS = 45


@pytest.fixture(scope="module")
def scans():
    generator = np.random.default_rng(4)
    return [np.round(generator.normal(0, 3, (1500, 3)), 6) for _ in range(SCANS)]


@pytest.fixture(scope="module")
def poses():
    return se3.exp(np.random.default_rng(5).normal(0, 0.3, (SCANS, 6)))


@pytest.fixture(scope="module")
def archive(scans, poses):
    return build_archive(scans, poses)


@pytest.fixture(autouse=True)
def hurry(monkeypatch):
    """No waiting, and blocks small enough for a member to need several."""
    monkeypatch.setattr(remote_file, "FIRST_DELAY", 0.001)
    monkeypatch.setattr(remote_file, "BLOCK", 4_000)
    monkeypatch.setattr(remote_file, "CHUNK", 100)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,127.0.0.2,localhost")


def fetch_scan(source, tmp_path, index=6, **options):
    path = tmp_path / "scan.csv"
    with open_archive(source, tmp_path / "cache", **options) as opened:
        opened.extract_scan(index, path)
    return read_scan(path)[0]


def member_bytes(archive, *tails):
    """Compressed sizes of members, their headers included."""
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        infos = [info for info in opened.infolist() if info.filename.endswith(tails)]
        return sum(30 + len(info.filename) + info.compress_size for info in infos)


def archive_of(tmp_path, members, method=zipfile.ZIP_DEFLATED):
    path = tmp_path / "made.zip"
    with zipfile.ZipFile(path, "w", method) as outer:
        for name, content in members:
            outer.writestr(name, content)
    return path


# Only what is needed


def test_two_scans_and_poses_cost_their_members_and_the_directory(
    scans, poses, archive, tmp_path, capsys
):
    with MisbehavingServer(archive) as server:
        with open_archive(server.url, tmp_path, len(archive)) as opened:
            opened.check_scans(SCANS)
            opened.extract_poses(tmp_path / "poses.csv")
            for index in (6, 7):
                opened.extract_scan(index, tmp_path / f"{index}.csv")
        needed = member_bytes(archive, "Hokuyo_6.csv", "Hokuyo_7.csv", "leica.csv")
        assert needed <= server.bytes_sent <= needed + 2 * remote_file.SMALL_BLOCK
        assert server.bytes_sent < len(archive) / 5
        assert server.most_connections == 1
        assert server.user_agents == {remote_file.USER_AGENT}
    for index in (6, 7):
        np.testing.assert_array_equal(read_scan(tmp_path / f"{index}.csv")[0], scans[index])
    np.testing.assert_array_equal(read_poses(tmp_path / "poses.csv", SCANS), poses)
    log = capsys.readouterr().err
    assert "of which only what is needed is read" in log
    assert "scan 6: " in log and "received in" in log
    assert not list(tmp_path.glob("*.part"))


def test_every_request_is_a_short_range(archive, tmp_path):
    with MisbehavingServer(archive) as server:
        fetch_scan(server.url, tmp_path)
        lengths = [last + 1 - first for first, last in server.ranges]
    assert max(lengths) <= max(remote_file.BLOCK, remote_file.SMALL_BLOCK)
    assert lengths.count(remote_file.BLOCK) >= 2


@pytest.mark.parametrize("pose_place", LEICA_PLACES)
@pytest.mark.parametrize("nested", [None, "stored", "deflated"])
@pytest.mark.parametrize("remote", [True, False])
def test_layouts(scans, poses, tmp_path, pose_place, nested, remote):
    content = build_archive(scans[:3], poses[:3], "stairs_26-Aug-2011", pose_place, nested)
    local = tmp_path / "by_hand.zip"
    local.write_bytes(content)
    with MisbehavingServer(content) as server:
        source = server.url if remote else local
        with open_archive(source, tmp_path / "cache") as opened:
            opened.check_scans(3)
            opened.extract_scan(2, tmp_path / "scan.csv")
            opened.extract_poses(tmp_path / "poses.csv")
    np.testing.assert_array_equal(read_scan(tmp_path / "scan.csv")[0], scans[2])
    np.testing.assert_array_equal(read_poses(tmp_path / "poses.csv", 3), poses[:3])


def test_theodolite_poses_of_the_first_place_win(scans, poses, tmp_path):
    path = archive_of(
        tmp_path,
        [
            ("r/csv_local/Hokuyo_0.csv", scan_csv(scans[0])),
            ("r/csv_global/pose_scanner_leica.csv", poses_csv(poses[1:2])),
            ("r/leica/pose_scanner_leica.csv", poses_csv(poses[:1])),
        ],
    )
    with open_archive(path, tmp_path) as opened:
        opened.extract_poses(tmp_path / "poses.csv")
    np.testing.assert_array_equal(read_poses(tmp_path / "poses.csv", 1), poses[:1])


def test_stored_nested_archive_is_read_where_it_stands(scans, poses, tmp_path):
    content = build_archive(scans, poses, nested="stored")
    with MisbehavingServer(content) as server:
        fetch_scan(server.url, tmp_path)
        assert server.bytes_sent < len(content) / 3


def test_deflated_nested_archive_is_fetched_once_with_a_notice(scans, poses, tmp_path, capsys):
    content = build_archive(scans, poses, nested="deflated")
    with MisbehavingServer(content) as server:
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path, 6), scans[6])
        assert "compressed as a whole, so all of it" in capsys.readouterr().err
        before = server.bytes_sent
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path, 7), scans[7])
        assert server.bytes_sent - before <= 3 * remote_file.SMALL_BLOCK
        assert "compressed as a whole" not in capsys.readouterr().err


def test_scan_count_that_differs_names_both_numbers_and_the_line(archive, tmp_path):
    (tmp_path / "a.zip").write_bytes(archive)
    with (
        open_archive(tmp_path / "a.zip", tmp_path) as opened,
        pytest.raises(DataError, match=r"45 scans in the archive.*`scans: 46`") as error,
    ):
        opened.check_scans(46)
    assert "missing: 45" in str(error.value)
    assert "change `scans: 46` to `scans: 45`" in str(error.value)


@pytest.mark.parametrize(("numbers", "scans"), [([0, 1, 3], 3), ([0, 1, 3], 4), ([0], 2)])
def test_scans_with_a_gap_are_not_counted_for_the_user(tmp_path, numbers, scans):
    names = [f"r/csv_local/Hokuyo_{number}.csv" for number in numbers]
    path = archive_of(tmp_path, [(name, "") for name in [*names, "r/leica/pose_scanner_leica.csv"]])
    with (
        open_archive(path, tmp_path) as opened,
        pytest.raises(DataError, match=rf"{len(numbers)} scans in the archive") as error,
    ):
        opened.check_scans(scans)
    problem, hint = str(error.value).split("\nHint: ")
    assert f"missing: {2 if 3 in numbers else 1}" in problem
    assert hint.startswith("at least 2 scans, numbered from 0 without gaps, are needed")
    assert "change `scans:" not in hint


def run_fetch_scan(tmp_path, content, drop_non_finite):
    """What the workflow's job does, on an archive on disk whose scan 1 is ``content``."""
    members = [("r/csv_local/Hokuyo_0.csv", ""), ("r/csv_local/Hokuyo_1.csv", content)]
    path = archive_of(tmp_path, [*members, ("r/leica/pose_scanner_leica.csv", "")])
    script = Path(__file__).parents[2] / "workflow/scripts/fetch_scan.py"
    run = runpy.run_path(str(script))["fetch_scan"]
    output = tmp_path / "1.parquet"
    plan = {"index": 1, "drop_non_finite": drop_non_finite}
    run({"path": str(path)}, tmp_path / "cache", output, 2, plan, None)
    return output


@pytest.mark.parametrize(
    ("row", "expected"),
    [("4,abc,6", ", line 3, column y: 'abc' is not a number."), ("4,nan,6", ": 1 of 2 rows are")],
)
def test_bad_scan_of_an_archive_is_named_by_the_archive(tmp_path, row, expected):
    with pytest.raises(DataError) as error:
        run_fetch_scan(tmp_path, f"x,y,z\n1,2,3\n{row}\n", False)
    problem, hint = str(error.value).split("\nHint: ")
    assert problem.startswith(f"{tmp_path / 'made.zip'}, Hokuyo_1.csv{expected}")
    assert hint.startswith("the archive holds it so.") and "`drop_non_finite: true`" in hint
    assert "extract the archive, mend the file" in hint and "export" not in hint
    assert not (tmp_path / "cache/scan_1.csv").exists()


def test_dropped_rows_of_an_archive_are_logged(tmp_path, caplog):
    caplog.set_level(logging.INFO)
    assert run_fetch_scan(tmp_path, "x,y,z\n1,2,3\n4,nan,6\n", True).is_file()
    assert "Hokuyo_1.csv: 1 points, 1 rows that are not finite dropped" in caplog.text


def test_scan_that_is_not_there(archive, tmp_path):
    (tmp_path / "a.zip").write_bytes(archive)
    with pytest.raises(DataError, match="no scan 45 among the 45"):
        fetch_scan(tmp_path / "a.zip", tmp_path, 45)


def test_extracted_folder_holds_the_same(scans, poses, tmp_path):
    write_folder(tmp_path, scans[:2], poses[:2], "csv_global")
    paths, pose_path = find_folder_files(tmp_path, 2)
    np.testing.assert_array_equal(read_scan(paths[1])[0], scans[1])
    np.testing.assert_array_equal(read_poses(pose_path, 2), poses[:2])


# A server that drops connections

TRANSIENT = ["drop", "truncate", "restart", "overflow", "busy", "too_many", "ignore_range", "shift"]


@pytest.mark.parametrize("fault", [*TRANSIENT, "compress"])
@pytest.mark.parametrize("request_number", [0, 1, 4])
def test_a_passing_fault_is_survived(scans, archive, tmp_path, fault, request_number, capsys):
    with MisbehavingServer(archive, [""] * request_number + [fault]) as server:
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])
        assert not server.faults
    assert "damaged" not in capsys.readouterr().err  # noticed by its headers, not by the CRC


def test_random_faults_are_survived(scans, archive, tmp_path):
    generator = random.Random(1)
    faults = [generator.choice([*TRANSIENT, "", "", ""]) for _ in range(60)]
    with MisbehavingServer(archive, faults) as server:
        for index in range(5):
            np.testing.assert_array_equal(fetch_scan(server.url, tmp_path, index), scans[index])


def test_dropped_ranges_continue_where_they_stopped(archive, tmp_path):
    with MisbehavingServer(archive) as server:
        fetch_scan(server.url, tmp_path)
        cost = server.bytes_sent
    (tmp_path / "again").mkdir()
    with MisbehavingServer(archive, ["", "", "", "drop", "", "drop", "drop"]) as server:
        fetch_scan(server.url, tmp_path / "again")
        assert cost <= server.bytes_sent <= cost + 3 * remote_file.CHUNK


def test_a_server_that_drops_every_connection_is_survived(scans, archive, tmp_path, monkeypatch):
    monkeypatch.setattr(remote_file, "BLOCK", 2**20)
    with MisbehavingServer(archive, ["", ""], always="dribble") as server:
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])
        assert len(server.ranges) > remote_file.ATTEMPTS


def test_a_stalled_connection_is_given_up(scans, archive, tmp_path, monkeypatch):
    monkeypatch.setattr(remote_file, "TIMEOUT", (1, 0.2))
    with MisbehavingServer(archive, ["", "", "stall"]) as server:
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])


@pytest.mark.parametrize("fault", ["truncate", "restart", "busy", "too_many", "shift"])
def test_a_lasting_fault_is_one_clear_error(archive, tmp_path, fault):
    with (
        MisbehavingServer(archive, ["", ""], always=fault) as server,
        pytest.raises(DataError) as error,
    ):
        fetch_scan(server.url, tmp_path)
    message = str(error.value)
    assert server.url in message and "bytes received" in message
    assert f"{remote_file.ATTEMPTS} attempts failed" in message
    assert citation.DOI in message and "archive: {path:" in message
    assert len(message.splitlines()) <= 12
    assert not (tmp_path / "scan.csv").exists()


def test_an_interrupted_run_is_continued_by_the_next(scans, archive, tmp_path):
    with MisbehavingServer(archive) as server:
        fetch_scan(server.url, tmp_path / "undisturbed")
        cost = server.bytes_sent
    with MisbehavingServer(archive, [""] * 5, always="busy") as server:
        with pytest.raises(remote_file.DownloadError, match="it continues where this one stopped"):
            fetch_scan(server.url, tmp_path)
        sent_before = server.bytes_sent
        assert len(list((tmp_path / "cache").glob("*.part"))) == 1
        server.always = ""
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])
        assert server.bytes_sent - sent_before == cost - 3 * remote_file.BLOCK
    assert not list((tmp_path / "cache").glob("*.part"))


def test_a_killed_process_leaves_no_file_that_looks_whole(scans, archive, tmp_path):
    program = (
        "import sys; from pathlib import Path\n"
        "from icpshap.data import archive, remote_file\n"
        "remote_file.BLOCK = 4_000\n"
        "with archive.open_archive(sys.argv[1], sys.argv[2]) as opened:\n"
        "    opened.extract_scan(6, Path(sys.argv[2]) / 'scan.csv')\n"
    )
    with MisbehavingServer(archive, [""] * 5, always="stall") as server:
        process = subprocess.Popen(
            [sys.executable, "-c", program, server.url, str(tmp_path / "cache")],
            cwd=Path(__file__).parents[2],
        )
        deadline = time.monotonic() + 20
        while len(server.ranges) < 6 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert process.poll() is None and len(server.ranges) == 6  # in the middle of the scan
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert not (tmp_path / "cache" / "scan.csv").exists()
        server.always = ""
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])


@pytest.mark.parametrize("block", [4_000, 1_000_000])
def test_damage_in_transit_is_read_again(scans, archive, tmp_path, capsys, monkeypatch, block):
    monkeypatch.setattr(remote_file, "BLOCK", block)
    with MisbehavingServer(archive, ["", "", "corrupt"]) as server:
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])
    assert "scan 6: damaged" in capsys.readouterr().err


def test_lasting_damage_is_an_error(archive, tmp_path):
    damaged = bytearray(archive)
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        info = opened.getinfo("apartment/csv_local/Hokuyo_6.csv")
    damaged[info.header_offset + 30 + len(info.filename) + info.compress_size // 2] ^= 0xFF
    with (
        MisbehavingServer(bytes(damaged)) as server,
        pytest.raises(DataError, match=r"scan 6 is damaged, read twice"),
    ):
        fetch_scan(server.url, tmp_path)
    assert not (tmp_path / "scan.csv").exists()
    (tmp_path / "local.zip").write_bytes(damaged)
    with pytest.raises(DataError, match=r"scan 6 is damaged, read twice"):
        fetch_scan(tmp_path / "local.zip", tmp_path)


def test_server_without_ranges_falls_back_to_the_whole_archive(scans, archive, tmp_path, capsys):
    sums = {name: hashlib.new(name, archive).hexdigest() for name in ("md5", "sha256")}
    with MisbehavingServer(
        archive, ["ignore_range"] * 3 + ["drop_whole"], always="ignore_range"
    ) as server:
        options = {"expected_bytes": len(archive), "checksums": sums}
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path, 6, **options), scans[6])
        requests_before = len(server.ranges)
        np.testing.assert_array_equal(fetch_scan(server.url, tmp_path, 7, **options), scans[7])
        assert len(server.ranges) == requests_before  # it is on disk now
    assert "serves no ranges, so the whole archive is downloaded" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["md5", "sha256"])
def test_whole_archive_with_another_checksum_is_refused(archive, tmp_path, name):
    with (
        MisbehavingServer(archive, always="ignore_range") as server,
        pytest.raises(DataError, match=rf"its {name} is \w+, but the configuration says 0"),
    ):
        fetch_scan(server.url, tmp_path, checksums={name: "0"})
    assert not list((tmp_path / "cache").glob("*.zip"))


def test_archive_on_disk_is_verified_once(archive, tmp_path, monkeypatch):
    path = tmp_path / "a.zip"
    path.write_bytes(archive)
    with pytest.raises(DataError, match=r"its md5 is \w+, but the configuration says 0"):
        fetch_scan(path, tmp_path, checksums={"md5": "0"})
    sums = {"md5": hashlib.md5(archive).hexdigest()}
    fetch_scan(path, tmp_path, checksums=sums)
    monkeypatch.setattr("icpshap.data.archive.verify_checksums", None)
    fetch_scan(path, tmp_path, checksums=sums)


def test_forbidden_names_the_user_agent(archive, tmp_path, monkeypatch):
    monkeypatch.setattr(remote_file, "USER_AGENT", "python-urllib/3.11")
    with (
        MisbehavingServer(archive) as server,
        pytest.raises(remote_file.DownloadError, match=r"HTTP 403.*\n?.*User-Agents") as error,
    ):
        fetch_scan(server.url, tmp_path)
    assert len(server.ranges) == 1  # asking again would be rude
    assert citation.DOI in str(error.value)


def test_missing_file_is_not_asked_for_twice(archive, tmp_path):
    with (
        MisbehavingServer(archive, always="missing") as server,
        pytest.raises(remote_file.DownloadError, match="HTTP 404"),
    ):
        fetch_scan(server.url, tmp_path)
    assert len(server.ranges) == 1


@pytest.mark.parametrize("fault", ["busy", "too_many"])
def test_retry_after_is_respected(archive, tmp_path, monkeypatch, fault):
    waits = []
    monkeypatch.setattr(time, "sleep", waits.append)
    with MisbehavingServer(archive, [fault], retry_after="7") as server:
        fetch_scan(server.url, tmp_path)
    assert waits == [7.0]


def test_retry_after_may_be_a_date():
    assert remote_file._retry_after("Wed, 21 Oct 2015 07:28:00 GMT") == 0.0
    assert remote_file._retry_after("Wed, 21 Oct 2065 07:28:00 GMT") > 1e9
    assert remote_file._retry_after("") == 0.0


def test_a_very_long_retry_after_is_an_error(archive, tmp_path):
    with (
        MisbehavingServer(archive, ["busy"], retry_after="3600") as server,
        pytest.raises(remote_file.DownloadError, match="the server asks to wait 3600 s"),
    ):
        fetch_scan(server.url, tmp_path)


def test_waits_grow_and_differ(archive, tmp_path, monkeypatch):
    waits = []
    monkeypatch.setattr(time, "sleep", waits.append)
    monkeypatch.setattr(remote_file, "FIRST_DELAY", 1.0)
    with (
        MisbehavingServer(archive, always="busy") as server,
        pytest.raises(remote_file.DownloadError),
    ):
        fetch_scan(server.url, tmp_path)
    nominal = 2.0 ** np.arange(remote_file.ATTEMPTS - 1)
    assert np.all(waits >= nominal * 0.5) and np.all(waits <= nominal * 1.5)
    assert len(set(np.round(waits / nominal, 6))) == len(waits)


@pytest.mark.parametrize("fault", ["replace", "grow"])
def test_a_file_that_changes_between_ranges_is_refused(scans, archive, tmp_path, fault):
    with MisbehavingServer(archive) as server:
        fetch_scan(server.url, tmp_path / "undisturbed")
        cost = server.bytes_sent
    with MisbehavingServer(archive, [""] * 4 + [fault]) as server:
        with pytest.raises(remote_file.DownloadError, match="changed while it was read"):
            fetch_scan(server.url, tmp_path)
        assert not (tmp_path / "scan.csv").exists()
        if fault == "replace":
            # Pieces of the first version are not used for the second.
            server.settle()
            server.bytes_sent = 0
            np.testing.assert_array_equal(fetch_scan(server.url, tmp_path), scans[6])
            assert server.bytes_sent == cost


# Trust


def test_size_is_checked_before_anything_is_read(archive, tmp_path):
    with (
        MisbehavingServer(archive) as server,
        pytest.raises(
            remote_file.DownloadError,
            match=rf"has {len(archive)} bytes, but the configuration says `bytes: 5`",
        ),
    ):
        fetch_scan(server.url, tmp_path, expected_bytes=5)
    assert server.bytes_sent <= 1
    (tmp_path / "a.zip").write_bytes(archive[:-100])
    with pytest.raises(DataError, match=rf"`bytes: {len(archive)}`"):
        fetch_scan(tmp_path / "a.zip", tmp_path, expected_bytes=len(archive))


def test_member_names_are_never_paths(scans, poses, tmp_path):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as outer:
        outer.writestr("../../../csv_local/Hokuyo_0.csv", scan_csv(scans[0]))
        outer.writestr("/leica/pose_scanner_leica.csv", poses_csv(poses[:1]))
    inside = tmp_path / "a" / "b" / "c"
    inside.mkdir(parents=True)
    (inside / "x.zip").write_bytes(buffer.getvalue())
    fetch_scan(inside / "x.zip", inside, 0)
    files = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert {file for file in files if "verified" not in file} == {"a/b/c/x.zip", "a/b/c/scan.csv"}
    assert all(file.startswith("a/b/c/") for file in files)


def test_decompression_is_bounded(scans, poses, tmp_path, monkeypatch):
    members = [
        ("r/csv_local/Hokuyo_0.csv", scan_csv(scans[0])),
        ("r/leica/pose_scanner_leica.csv", poses_csv(poses[:1])),
    ]
    path = archive_of(tmp_path, members)
    monkeypatch.setattr("icpshap.data.archive.MAXIMUM_MEMBER", 1000)
    with pytest.raises(DataError, match=r"scan 0 claims \d+ bytes, at most 1000"):
        fetch_scan(path, tmp_path, 0)


def test_member_larger_than_it_claims_is_refused(scans, poses, tmp_path):
    path = archive_of(
        tmp_path,
        [
            ("r/csv_local/Hokuyo_0.csv", "x" * 5_000_000),
            ("r/leica/pose_scanner_leica.csv", poses_csv(poses[:1])),
        ],
    )
    content = path.read_bytes()
    assert content.count((5_000_000).to_bytes(4, "little")) == 2
    path.write_bytes(content.replace((5_000_000).to_bytes(4, "little"), b"\x10\0\0\0"))
    with pytest.raises(DataError, match="scan 0 is damaged"):
        fetch_scan(path, tmp_path, 0)
    assert not (tmp_path / "scan.csv").exists()


def test_a_directory_of_absurd_size_is_not_read(archive, tmp_path, monkeypatch):
    monkeypatch.setattr(remote_file, "MAXIMUM_READ", 1000)
    with (
        MisbehavingServer(archive) as server,
        pytest.raises(DataError, match=r"a table of \d+ bytes is announced"),
    ):
        fetch_scan(server.url, tmp_path)


@pytest.mark.parametrize(
    ("members", "problem"),
    [
        ([("r/leica/pose_scanner_leica.csv", "")], "no csv_local/Hokuyo_<i>.csv in the archive"),
        ([("r/csv_local/Hokuyo_0.csv", "")], "no pose file pose_scanner_leica.csv"),
        (
            [("r/csv_local/Hokuyo_0.csv", ""), ("s/csv_local/Hokuyo_0.csv", "")],
            "'r/csv_local/Hokuyo_0.csv' and 's/csv_local/Hokuyo_0.csv' are both",
        ),
        ([("__MACOSX/csv_local/._Hokuyo_0.csv", "")], "no csv_local/Hokuyo_<i>.csv"),
    ],
)
def test_archives_of_another_layout(tmp_path, members, problem):
    with pytest.raises(DataError, match=problem):
        open_archive(archive_of(tmp_path, members), tmp_path)


@pytest.mark.parametrize("content", [b"", b"<html>Not here</html>", None])
def test_not_a_zip(archive, tmp_path, content):
    path = tmp_path / "a.zip"
    path.write_bytes(archive[: len(archive) // 2] if content is None else content)
    with pytest.raises(DataError, match="is not a whole ZIP archive"):
        open_archive(path, tmp_path)


def test_unreadable_compression_is_named(scans, poses, tmp_path):
    path = archive_of(
        tmp_path,
        [
            ("r/csv_local/Hokuyo_0.csv", scan_csv(scans[0])),
            ("r/leica/pose_scanner_leica.csv", poses_csv(poses[:1])),
        ],
    )
    content = bytearray(path.read_bytes())
    content[8] = 9  # deflate64, in the member's header
    content[content.index(b"PK\1\2") + 10] = 9  # and in the directory
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"cannot be decompressed \(That compression"):
        fetch_scan(path, tmp_path, 0)


def test_plain_http_is_for_this_machine_only(tmp_path):
    with pytest.raises(remote_file.DownloadError, match="not an https address"):
        open_archive("http://example.org/a.zip", tmp_path)


def test_redirection_to_plain_http_is_refused(archive, tmp_path):
    with (
        MisbehavingServer(archive, ["redirect"]) as server,
        pytest.raises(remote_file.DownloadError, match=r"http://127.0.0.2.*not an https address"),
    ):
        fetch_scan(server.url, tmp_path)


def test_missing_local_archive(tmp_path):
    with pytest.raises(DataError, match=r"nowhere.zip: no such archive"):
        open_archive(tmp_path / "nowhere.zip", tmp_path)


def test_full_disk_is_noticed_before_a_large_download(scans, poses, tmp_path, monkeypatch):
    content = build_archive(scans[:2], poses[:2], nested="deflated")
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: type("Usage", (), {"free": 1000}))
    with (
        MisbehavingServer(content) as server,
        pytest.raises(DataError, match=r"B are needed, 1.0 kB are free"),
    ):
        fetch_scan(server.url, tmp_path)


# Progress, and no network


def test_progress_moves_on_a_terminal_and_is_plain_in_a_log(capsys, monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    clock = iter(np.arange(0.0, 100.0, 5.0))
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    terminal = Terminal()
    progress = remote_file.Progress("scan 6", 10_000_000, terminal)
    for _ in range(4):
        progress.add(2_000_000)
    progress.finish()
    moving = terminal.getvalue()
    assert moving.count("\r") == 5 and "\n" not in moving
    assert "scan 6: 2.0 MB of 10.0 MB, 400.0 kB/s, 20 s left" in moving
    log = capsys.readouterr().err
    assert log.splitlines() == [
        "scan 6: 4.0 MB of 10.0 MB, 400.0 kB/s, 15 s left",
        "scan 6: 8.0 MB of 10.0 MB, 400.0 kB/s, 5 s left",
        "scan 6: 8.0 MB in 25.0 s",
    ]


@pytest.mark.parametrize("url", ["http://127.0.0.1:9/content", "https://nowhere.invalid/content"])
def test_without_network_one_screen_says_what_to_do(tmp_path, monkeypatch, url):
    monkeypatch.setenv("NO_PROXY", "*")
    with pytest.raises(remote_file.DownloadError) as error:
        open_archive(url, tmp_path)
    message = str(error.value)
    assert url in message and "3 attempts failed" in message
    assert "10.3929/ethz-b-000721626" in message and "archive: {path:" in message
    assert "snakemake -j2 --configfile config/demo.yaml" in message
    assert "object at" not in message
    assert len(message.splitlines()) <= 12 and max(map(len, message.splitlines())) <= 160


def test_archive_on_disk_needs_no_network(archive, tmp_path, scans, monkeypatch):
    monkeypatch.setattr(remote_file, "RemoteFile", None)
    (tmp_path / "a.zip").write_bytes(archive)
    np.testing.assert_array_equal(fetch_scan(tmp_path / "a.zip", tmp_path), scans[6])


def test_sequence_as_the_configuration_describes_it(scans, archive, tmp_path):
    with MisbehavingServer(archive) as server:
        described = {"url": server.url, "bytes": len(archive)}
        with open_sequence(described, tmp_path, SCANS) as opened:
            opened.extract_scan(6, tmp_path / "6.csv")
        np.testing.assert_array_equal(read_scan(tmp_path / "6.csv")[0], scans[6])
        with (
            pytest.raises(DataError, match="45 scans in the archive"),
            open_sequence(described, tmp_path, 44),
        ):
            pass
    (tmp_path / "a.zip").write_bytes(archive)
    with open_sequence({**described, "path": tmp_path / "a.zip"}, tmp_path, SCANS) as opened:
        opened.extract_scan(7, tmp_path / "7.csv")
    np.testing.assert_array_equal(read_scan(tmp_path / "7.csv")[0], scans[7])


def test_licence_and_citation():
    assert "CC BY 4.0" in citation.NOTICE and "Pomerleau" in citation.NOTICE
