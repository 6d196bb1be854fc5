"""Archives with one thing wrong, on disk and on a server: refused by name, nothing left behind."""

import itertools
import re
import stat
import time
import tracemalloc
import zipfile

import numpy as np
import pytest
from hostile_files import POSES, SCAN, edited, zipped
from known_files import POINTS, written
from misbehaving_server import MisbehavingServer, scan_csv

from icpshap.data import archive as archive_module
from icpshap.data import remote_file
from icpshap.data.archive import open_archive, open_sequence
from icpshap.data.scans import read_scan
from icpshap.errors import DataError

TEXT = scan_csv(POINTS)
MEMBERS = [(SCAN, TEXT), (POSES, "")]
# Offsets in an entry of the directory.
VERSION, FLAGS, METHOD, CRC, PACKED, SIZE, NAME_LENGTH, EXTRA_LENGTH, ATTRIBUTES, OFFSET = (
    *(6, 8, 10, 16, 20, 24, 28, 30, 38, 42),
)


@pytest.fixture(autouse=True)
def hurry(monkeypatch):
    monkeypatch.setattr(remote_file, "FIRST_DELAY", 0.001)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1,localhost")


@pytest.fixture(params=["on disk", "on a server"])
def extract(request, tmp_path):
    """A function that extracts scan 0 and the poses of an archive; it checks what is left.

    Nothing may lie beside the cache, and no file of the scan's name unless it was extracted.
    """
    cache = tmp_path / "home" / "cache"

    def extracted(path):
        try:
            if request.param == "on disk":
                return taken(path)
            with MisbehavingServer(path.read_bytes()) as server:
                return taken(server.url)
        except DataError as error:
            message = str(error).partition("\nHint: ")[0]
            assert str(path) in message or "http://127.0.0.1" in message or str(cache) in message
            assert not (cache / "scan.csv").exists() and not list(cache.glob("*.part"))
            raise
        finally:
            left = {file for file in tmp_path.rglob("*") if not file.is_dir()}
            assert {file for file in left if cache not in file.parents} == {path}
            assert all(file.is_file() and not file.is_symlink() for file in left)

    def taken(source):
        with open_archive(source, cache) as opened:
            opened.extract_poses(cache / "poses.csv")
            opened.extract_scan(0, cache / "scan.csv")
        return read_scan(cache / "scan.csv")[0]

    return extracted


def number(value, size=4):
    return value.to_bytes(size, "little")


def made(tmp_path, members=MEMBERS, *edits, method=zipfile.ZIP_DEFLATED):
    return edited(zipped(tmp_path / "a.zip", members, method), *edits)


def named(name, content, *, attributes=0):
    info = zipfile.ZipInfo(name)
    info.external_attr = attributes << 16
    return info, content


@pytest.mark.parametrize(
    "names",
    [
        ("../../../" + SCAN, "/../" + POSES),
        ("/" + SCAN, "/etc/" + POSES),
        (SCAN.replace("/", "\\"), POSES.replace("/", "\\")),
        ("C:\\..\\" + SCAN.replace("/", "\\"), "\\\\host\\" + POSES.replace("/", "\\")),
        ("\udcff/".encode("utf-8", "surrogatepass").decode("latin-1") + SCAN, "größe/" + POSES),
        ("a" * 60_000 + "/" + SCAN, "b\n/" + POSES),
    ],
    ids=["above", "absolute", "backslashes", "drives", "foreign", "long"],
)
def test_names_are_no_paths(tmp_path, extract, names):
    path = made(
        tmp_path, [(name, content) for name, (_, content) in zip(names, MEMBERS, strict=True)]
    )
    np.testing.assert_array_equal(extract(path), POINTS)


def test_other_members_are_never_unpacked(tmp_path, extract):
    link = named("r/csv_local/link", "/etc/passwd", attributes=stat.S_IFLNK | 0o777)
    members = [("../evil", "a"), link, ("r/csv_local/Hokuyo_0.csv/", ""), ("/evil.sh", "b")]
    np.testing.assert_array_equal(extract(made(tmp_path, members + MEMBERS)), POINTS)


SCAN_AT, POSES_AT = 0, 1  # members in the directory
BIG = number(2**32 - 1)
ENTRY_FAULTS = {
    "a scan of 3 GB": ([(SCAN_AT, SIZE, number(3 * 10**9))], "scan 0 claims 3000000000 bytes, at"),
    "poses of 3 GB": ([(POSES_AT, SIZE, number(3 * 10**9))], "poses claims 3000000000 bytes, at"),
    "less than there": ([(SCAN_AT, SIZE, number(16))], "scan 0 is damaged, read twice"),
    "more than there": ([(SCAN_AT, SIZE, number(10**6))], "scan 0 is damaged, read twice"),
    "a wrong CRC": ([(SCAN_AT, CRC, number(7))], "scan 0 is damaged, read twice .*Bad CRC-32"),
    "packed beyond the next": ([(SCAN_AT, PACKED, BIG[:3] + b"\0")], "scan 0 overlaps what stands"),
    "packed beyond the file": (
        [(SCAN_AT, PACKED, b"\xfe" + BIG[1:])],
        "scan 0 overlaps what stands",
    ),
    "packed in nothing": ([(SCAN_AT, PACKED, number(0))], "scan 0 is damaged, read twice"),
    "at the poses": ([(SCAN_AT, OFFSET, number(10**5))], "scan 0|poses"),
    "beyond the file": ([(SCAN_AT, OFFSET, number(2**31))], "scan 0 overlaps|poses overlaps"),
    "both at one place": ([(POSES_AT, OFFSET, number(0))], "poses|scan 0 overlaps"),
    "encrypted": ([(SCAN_AT, FLAGS, number(1, 2))], r"scan 0 cannot be decompressed .*encrypted"),
    "patched": ([(SCAN_AT, FLAGS, number(0x20, 2))], "scan 0 cannot be decompressed .*patched"),
    "bzip2": (
        [(SCAN_AT, METHOD, number(12, 2))],
        "cannot be decompressed .*method, 12, is neither",
    ),
    "lzma": ([(SCAN_AT, METHOD, number(14, 2))], "cannot be decompressed .*method, 14, is neither"),
    "method 99": ([(SCAN_AT, METHOD, number(99, 2))], "cannot be decompressed .*method, 99, is"),
    "stored in words": ([(SCAN_AT, METHOD, number(0, 2))], "scan 0 is damaged, read twice"),
    "a version to come": ([(SCAN_AT, VERSION, number(255, 2))], "not a whole ZIP archive"),
    "a long name": ([(SCAN_AT, NAME_LENGTH, number(9999, 2))], "not a whole ZIP|no csv_local"),
    "a long extra field": ([(SCAN_AT, EXTRA_LENGTH, number(9999, 2))], "not a whole ZIP archive"),
    "zip64 without it": ([(SCAN_AT, SIZE, BIG)], "claims 4294967295 bytes|not a whole ZIP archive"),
    "a link": ([(SCAN_AT, ATTRIBUTES, number(stat.S_IFLNK << 16))], "scan 0 is a symbolic link"),
}


@pytest.mark.parametrize(("edits", "expected"), ENTRY_FAULTS.values(), ids=ENTRY_FAULTS)
def test_entry_that_lies(tmp_path, extract, edits, expected):
    with pytest.raises(DataError, match=expected) as error:
        extract(made(tmp_path, MEMBERS, *edits))
    assert "\nHint: " in str(error.value)


def test_entry_that_lies_in_64_bits(tmp_path, extract):
    info, content = named(SCAN, TEXT)
    info.extra = number(1, 2) + number(16, 2) + number(2**62, 8) * 2
    path = made(tmp_path, [(info, content), MEMBERS[1]], (SCAN_AT, PACKED, BIG + BIG))
    with pytest.raises(DataError, match=r"scan 0 claims 4611686018427387904 bytes"):
        extract(path)


def ends(field, value):
    """Edit a field of the record at the end of an archive."""

    def edit(content):
        at = content.rindex(b"PK\5\6") + field
        return content[:at] + value + content[at + len(value) :]

    return edit


END_FAULTS = {
    "directory of 4 GB": ends(12, b"\xf0" + BIG[1:]),
    "directory of nothing": ends(12, number(0)),
    "half a directory": ends(12, number(50)),
    "directory elsewhere": ends(16, number(2**31)),
    "no record": lambda content: content[:-22],
    "the record alone": lambda content: content[-22:],
    "half of it": lambda content: content[: len(content) // 2],
    "only NUL": lambda content: bytes(10**5),
    "nothing": lambda content: b"",
    "records for ever": lambda content: content + b"PK\5\6" * 20_000,
    "a directory of no entries": lambda content: b"PK\5\6" + bytes(18),
}


@pytest.mark.parametrize("damage", END_FAULTS.values(), ids=END_FAULTS)
def test_directory_that_lies(tmp_path, extract, damage):
    path = made(tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    start = time.monotonic()
    with pytest.raises(DataError, match=r"\nHint: "):
        extract(path)
    assert time.monotonic() - start < 10


@pytest.mark.parametrize("lie", [(8, BIG), (20, BIG[:2])], ids=["entries", "comment"])
def test_numbers_that_need_not_be_believed(tmp_path, extract, lie):
    path = made(tmp_path)
    path.write_bytes(ends(*lie)(path.read_bytes()))
    np.testing.assert_array_equal(extract(path), POINTS)


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("twice", [SCAN, POSES, SCAN.replace("/", "\\"), "s/" + SCAN])
def test_a_member_twice_is_refused(tmp_path, extract, twice):
    with pytest.raises(DataError, match=r"are both in the archive.\nHint: "):
        extract(made(tmp_path, [*MEMBERS, (twice, "x,y,z\n")]))


def test_a_bomb_takes_no_memory(tmp_path, monkeypatch):
    """A member that expands to 200 MB, and claims 1 kB: not a piece of 2 MB of it is held."""
    path = made(tmp_path, [(SCAN, "0" * 2 * 10**8), (POSES, "")], (SCAN_AT, SIZE, number(1000)))
    tracemalloc.start()
    with (
        open_archive(path, tmp_path / "cache") as opened,
        pytest.raises(DataError, match="scan 0 is damaged"),
    ):
        opened.extract_scan(0, tmp_path / "scan.csv")
    assert tracemalloc.get_traced_memory()[1] < 8e6
    tracemalloc.stop()
    assert not (tmp_path / "scan.csv").exists()


def test_an_extracted_member_needs_room(tmp_path, monkeypatch):
    path = made(tmp_path)
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage)
    with (
        open_archive(path, tmp_path / "cache") as opened,
        pytest.raises(DataError, match=r"are needed, 1\.0 kB are free"),
    ):
        opened.extract_scan(0, tmp_path / "scan.csv")


def test_a_disk_that_is_full_after_all(tmp_path, monkeypatch):
    def fail(source, target, size):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("shutil.copyfileobj", fail)
    with (
        open_archive(made(tmp_path), tmp_path / "cache") as opened,
        pytest.raises(DataError, match=r"scan\.csv: scan 0 of .*\(No space left on device\)"),
    ):
        opened.extract_scan(0, tmp_path / "scan.csv")
    assert not list(tmp_path.glob("scan*"))


# Archives within the archive


def nested(tmp_path, *names, content=None, method=zipfile.ZIP_STORED):
    """An archive of archives, which hold scans and poses unless ``content`` is given."""
    inner = made(tmp_path).read_bytes() if content is None else content
    return made(tmp_path, [(name, inner) for name in names], method=method)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_nested_names_are_no_paths(tmp_path, extract, method):
    path = nested(tmp_path, "../../leica\\..\\evil.zip", method=method)
    np.testing.assert_array_equal(extract(path), POINTS)


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_nested_only_once(tmp_path, extract, method):
    inner = nested(tmp_path, "inner.zip").read_bytes()
    with pytest.raises(DataError, match=r"no csv_local/Hokuyo_<i>\.csv in the archive"):
        extract(nested(tmp_path, "outer.zip", content=inner, method=method))


@pytest.mark.parametrize(
    ("edits", "expected"),
    [
        ([(0, SIZE, number(2**31))], "'a.zip' in it|is not a whole ZIP|overlaps|damaged"),
        ([(0, OFFSET, number(2**31))], "overlaps what stands behind it"),
        ([(0, ATTRIBUTES, number(stat.S_IFLNK << 16))], "is a symbolic link, expected a file"),
        ([(0, METHOD, number(14, 2))], "cannot be decompressed .*method, 14"),
    ],
)
@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_nested_archive_that_lies(tmp_path, extract, edits, expected, method):
    with pytest.raises(DataError, match=expected):
        extract(edited(nested(tmp_path, "a.zip", method=method), *edits))


def test_nested_without_end(tmp_path, extract):
    empty = b"PK\5\6" + bytes(18)
    with pytest.raises(DataError, match="not in the first 100 of the archives within it"):
        extract(nested(tmp_path, *(f"{k}.zip" for k in range(300)), content=empty))


def test_nested_archives_together_are_bounded(tmp_path, monkeypatch, extract):
    empty = b"PK\5\6" + bytes(18)
    monkeypatch.setattr(archive_module, "MAXIMUM_NESTED", 100)
    with pytest.raises(
        DataError, match=r"'4\.zip', an archive within the archive, claims 22 bytes"
    ):
        extract(
            nested(
                tmp_path,
                *(f"{k}.zip" for k in range(9)),
                content=empty,
                method=zipfile.ZIP_DEFLATED,
            )
        )


# Places on disk


def test_archive_that_is_a_folder(tmp_path):
    with pytest.raises(DataError, match=r"a folder; expected a file.\nHint: "):
        open_archive(tmp_path, tmp_path / "cache")


def test_archive_that_is_a_dangling_link(tmp_path):
    (tmp_path / "a.zip").symlink_to("nowhere")
    with pytest.raises(DataError, match=r"a.zip: a symbolic link to nowhere, .*\nHint: "):
        open_archive(tmp_path / "a.zip", tmp_path / "cache")


def test_cache_that_is_a_file(tmp_path):
    cache = written(tmp_path / "cache", "")
    expected = r"cache: cannot be made \(File exists\).*\nHint: "
    with pytest.raises(DataError, match=expected):
        open_archive(made(tmp_path), cache)
    with (
        pytest.raises(DataError, match=expected),
        open_sequence({"path": made(tmp_path)}, cache, 1),
    ):
        pass


def test_lock_that_is_a_folder(tmp_path):
    (tmp_path / "cache" / "lock").mkdir(parents=True)
    expected = r"lock: cannot be written \(Is a directory\).\nHint: "
    with (
        pytest.raises(DataError, match=expected),
        open_sequence({"path": made(tmp_path)}, tmp_path / "cache", 1),
    ):
        pass


# Servers


def test_a_body_that_trickles_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(remote_file, "PATIENCE", 0.1)
    monkeypatch.setattr(remote_file, "ATTEMPTS", 2)
    content = made(tmp_path).read_bytes()
    with (
        MisbehavingServer(content, [""], always="trickle") as server,
        pytest.raises(remote_file.DownloadError, match=r"bytes arrived in 0 s.*\n?.*\nHint"),
    ):
        start = time.monotonic()
        open_archive(server.url, tmp_path / "cache")
    assert time.monotonic() - start < 20


def test_a_whole_file_longer_than_announced_is_not_kept(tmp_path):
    content = made(tmp_path).read_bytes()
    with (
        MisbehavingServer(content, always="inflate") as server,
        pytest.raises(
            remote_file.DownloadError, match=r"more than the announced \d+ bytes arrived"
        ) as error,
    ):
        open_archive(server.url, tmp_path / "cache")
    announced = int(re.search(r"announced (\d+)", str(error.value))[1])
    kept = list((tmp_path / "cache").iterdir())
    assert sum(file.stat().st_size for file in kept) <= announced


def test_a_whole_file_of_absurd_length_is_not_begun(tmp_path, monkeypatch):
    usage = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("shutil.disk_usage", lambda folder: usage)
    with (
        MisbehavingServer(made(tmp_path).read_bytes(), always="ignore_range") as server,
        pytest.raises(DataError, match=r"are needed, 1\.0 kB are free"),
    ):
        open_archive(server.url, tmp_path / "cache")


def test_a_size_that_is_a_lie(tmp_path):
    """A server that announces 10^18 bytes, and has none of them at the end."""
    content = made(tmp_path).read_bytes()
    with (
        MisbehavingServer(content, always="boast") as server,
        pytest.raises(DataError, match=r"attempts failed|is not a whole ZIP"),
    ):
        open_archive(server.url, tmp_path / "cache")


# Single bits


def test_flipped_bits_of_an_archive(tmp_path):
    """Each flip gives the same bytes or an error: a member has a checksum."""
    path = zipped(tmp_path / "a.zip", [(SCAN, TEXT[:3000]), (POSES, "poses\n")])
    content = path.read_bytes()
    generator = np.random.default_rng(6)
    ends = range(len(content) - 250, len(content))  # most of what is not checked is there
    positions = [*generator.integers(0, len(content), 200), *generator.choice(ends, 300)]
    refused = 0
    for position, bit in zip(positions, itertools.cycle(range(8)), strict=False):
        flipped = bytearray(content)
        flipped[position] ^= 1 << bit
        path.write_bytes(flipped)
        try:
            with open_archive(path, tmp_path / "cache") as opened:
                opened.extract_scan(0, tmp_path / "scan.csv")
                opened.extract_poses(tmp_path / "poses.csv")
        except DataError as error:
            assert str(path) in str(error) and "\nHint: " in str(error)
            refused += 1
            continue
        assert (tmp_path / "scan.csv").read_bytes() == TEXT[:3000].encode()
        assert (tmp_path / "poses.csv").read_bytes() == b"poses\n"
    assert refused > 250
