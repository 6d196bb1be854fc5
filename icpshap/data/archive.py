"""Scans and poses out of the data set's archives, remote or on disk, without the rest of them.

The directory of a ZIP stands at its end, so single members are read out of a remote archive by
Range requests. Members are found by the tails of their names, which are never used as paths.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import re
import shutil
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TextIO

from icpshap.data.citation import DOI
from icpshap.data.files import readable
from icpshap.data.layout import LEICA_NAME, LEICA_PLACES, MINIMUM_SCANS
from icpshap.data.remote_file import (
    LocalFile,
    RangeIgnoredError,
    RemoteFile,
    Window,
    amount,
    require_space,
    say,
)
from icpshap.errors import DataError

if TYPE_CHECKING:
    from icpshap.data.remote_file import SeekableView


BY_HAND = (
    f"download the archive from {DOI} in a browser and give this sequence\n"
    "    `archive: {path: <the .zip>}` in place of its `url`, or extract it and give it\n"
    "    `archive: null` and `folder: {path: <what holds csv_local/>}`"
)
ALTERNATIVES = (
    f"Without this server:\n  - {BY_HAND}\n"
    "  - or use simulated scans: snakemake -j2 --configfile config/demo.yaml"
)

MAXIMUM_MEMBER = 2**31  # bytes of a scan or a pose file (a scan has about 30 MB)
MAXIMUM_NESTED = 2**34  # bytes of all archives within the archive that have to be unpacked
MAXIMUM_INSIDE = 100  # archives within the archive that are looked into
LOCAL_HEADER = 30  # bytes before the name of a member
CHUNK = 2**20  # bytes decompressed at a time

SCAN_TAIL = re.compile(r"(?:^|/)csv_local/Hokuyo_([0-9]{1,6})\.csv\Z")
POSES_TAIL = re.compile(rf"(?:^|/)(?:([^/]+)/)?{re.escape(LEICA_NAME)}\Z")


@contextlib.contextmanager
def open_sequence(
    archive: Mapping[str, Any], cache: Path, scans: int, terminal: TextIO | None = None
) -> Iterator[Archive]:
    """Open the archive of a sequence as the configuration describes it: an `Archive`.

    ``archive``: mapping with ``url`` or ``path`` and, where known, ``bytes``, ``md5``, ``sha256``;
    ``cache``, ``terminal``: see `open_archive`. One process at a time reads an archive, so that two
    never download the same. Raises DataError, also unless it holds the scans 0 to ``scans`` - 1.
    """
    checksums = {name: archive[name] for name in ("md5", "sha256") if name in archive}
    source = archive.get("path") or archive["url"]
    with (
        _locked(Path(cache)),
        open_archive(source, cache, archive.get("bytes"), checksums, terminal) as members,
    ):
        members.check_scans(scans)
        yield members


def open_archive(
    source: str,
    cache: Path,
    expected_bytes: int | None = None,
    checksums: Mapping[str, str] | None = None,
    terminal: TextIO | None = None,
) -> Archive:
    """Open an archive of the data set: an `Archive`, for a ``with`` statement.

    ``source`` is an https URL (http on this machine alone) or the path of a ZIP on disk. The folder
    ``cache`` keeps what serves later runs: pieces of interrupted downloads, and archives that can
    only be had whole. ``expected_bytes`` is checked before anything is read; ``checksums``
    ({"md5": hex, "sha256": hex}) once for an archive at hand as a whole. ``terminal``: see
    `Progress`. Raises DataError.
    """
    cache = Path(cache)
    _make_folder(cache)
    whole = cache / f"archive_{zlib.crc32(str(source).encode()):08x}.zip"
    if "://" not in str(source):
        file = _open_file(Path(source), expected_bytes)
        with readable(Path(source)):
            _verify_once(Path(source), checksums or {}, cache)
        return Archive(file, source, cache)
    if not whole.is_file():
        file = RemoteFile(str(source), ALTERNATIVES, expected_bytes, terminal)
        try:
            file.connect()
            say(f"{source}: {amount(file.size)}, of which only what is needed is read")
            return Archive(file, source, cache)
        except RangeIgnoredError:
            say(f"{source}: the server serves no ranges, so the whole archive is downloaded")
            file.download(whole, lambda path: verify_checksums(path, checksums or {}))
            file.close()
    return Archive(_open_file(whole, expected_bytes), source, cache)


@contextlib.contextmanager
def _locked(cache):
    """While this lasts, the folder ``cache``, which is made, is this process's alone."""
    _make_folder(cache)
    try:
        lock = (cache / "lock").open("w", encoding="utf-8")
    except OSError as error:
        raise DataError(
            f"{cache / 'lock'}: cannot be written ({error.strerror or error}).",
            "check the permissions of the folder, and the disk.",
        ) from None
    with lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _make_folder(path):
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(
            f"{path}: cannot be made ({error.strerror or error}); expected a folder for pieces of"
            " the archive.",
            "take away what is there, or check the permissions of the folder above.",
        ) from None


def _open_file(path, expected_bytes):
    if not (path.exists() or path.is_symlink()):
        raise DataError(f"{path}: no such archive.", f"correct `path`, or {BY_HAND}.")
    with readable(path):
        file = LocalFile(path)
    if expected_bytes not in (None, file.size):
        file.close()
        raise DataError(
            f"{path}: {file.size} bytes, but the configuration says `bytes: {expected_bytes}`.",
            f"the file may be cut off or another one; {BY_HAND}.",
        )
    return file


def verify_checksums(path: Path, checksums: Mapping[str, str]) -> None:
    """Raise DataError unless the file has the ``checksums`` {"md5": hex, "sha256": hex}."""
    for name, expected in checksums.items():
        with path.open("rb") as file:
            found = hashlib.file_digest(file, name).hexdigest()
        if found != expected:
            raise DataError(
                f"{path}: its {name} is {found}, but the configuration says {expected}.",
                f"get it again; if it was replaced on purpose ({DOI}), correct `{name}`.",
            )


def _verify_once(path, checksums, cache):
    """`verify_checksums`, unless this very file passed before: gigabytes take a while."""
    state = path.stat()
    known = repr((str(path.resolve()), state.st_size, state.st_mtime_ns, checksums))
    passed = cache / f"verified_{zlib.crc32(known.encode()):08x}"
    if not passed.exists():
        verify_checksums(path, checksums)
        passed.touch()


class _Member(NamedTuple):
    container: zipfile.ZipFile
    info: zipfile.ZipInfo
    remote: RemoteFile | None
    start: int  # its bytes in the remote file
    end: int


class Archive:
    """The scans and poses in one archive of the data set; `open_archive` makes it."""

    def __init__(self, file: SeekableView, source: str | Path, cache: Path) -> None:
        self._source, self._cache = source, cache
        self._remote = file if isinstance(file, RemoteFile) else None
        self._scans: dict[int, _Member] = {}
        self._poses: dict[str, _Member] = {}
        self._inside = self._unpacked = 0  # archives looked into, and bytes of those unpacked
        with contextlib.ExitStack() as files:
            self._files = files
            self._read_directory(file, file, 0, "")
            self._require_members()
            self._files = files.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._remote:
            received, count = self._remote.received, self._remote.requests
            say(f"{self._source}: {amount(received)} received in {count} requests")
        self._files.close()

    def check_scans(self, scans: int) -> None:
        """Raise DataError unless the scans are 0 to ``scans`` - 1."""
        missing = sorted(set(range(scans)) - set(self._scans))
        found = len(self._scans)
        if missing or found != scans:
            example = f"; missing: {', '.join(map(str, missing[:5]))}" if missing else ""
            if found < MINIMUM_SCANS or set(self._scans) != set(range(found)):
                hint = (
                    f"at least {MINIMUM_SCANS} scans, numbered from 0 without gaps, are needed; get"
                    " the archive again, or extract it, number its scans and poses so, and set"
                    " `archive: null` and `folder: {path: ...}`."
                )
            else:
                hint = (
                    f"change `scans: {scans}` to `scans: {found}` in this sequence's entry under"
                    " `data`."
                )
            raise DataError(
                f"{self._source}: {found} scans in the archive, but the configuration says"
                f" `scans: {scans}` (numbered from 0 without gaps){example}.",
                hint,
            )

    def extract_scan(self, index: int, destination: str | Path) -> None:
        """Write ``Hokuyo_<index>.csv`` to the path ``destination``. Raises DataError."""
        if index not in self._scans:
            raise DataError(
                f"{self._source}: no scan {index} among the {len(self._scans)} in the archive.",
                "correct `scans` or `pairs` in the configuration.",
            )
        self._extract(self._scans[index], destination, f"scan {index}", MAXIMUM_MEMBER)

    def extract_poses(self, destination: str | Path) -> None:
        """Write ``pose_scanner_leica.csv`` to the path ``destination``. Raises DataError."""
        places = [place for place in LEICA_PLACES if place in self._poses] or list(self._poses)
        self._extract(self._poses[places[0]], destination, "poses", MAXIMUM_MEMBER)

    def _require_members(self):
        if not (self._scans and self._poses):
            missing = f"pose file {LEICA_NAME}" if self._scans else "csv_local/Hokuyo_<i>.csv"
            raise DataError(
                f"{self._source}: no {missing} in the archive.",
                "if its layout is new, extract it by hand and set `folder: {path: ...}`.",
            )

    def _read_directory(self, file, outermost, offset, prefix):
        """Take in the scans and poses of the ZIP ``file``, at ``offset`` in the outermost file."""
        self._files.callback(file.close)
        container = self._container(file, prefix)
        members = sorted(container.infolist(), key=lambda info: info.header_offset)
        ends = [*(info.header_offset for info in members), container.start_dir][1:]
        remote = outermost if isinstance(outermost, RemoteFile) else None
        scans: dict[int, _Member] = {}
        poses: dict[str, _Member] = {}
        nested = []
        for info, end in zip(members, ends, strict=True):
            member = _Member(container, info, remote, offset + info.header_offset, offset + end)
            # Some programs write the separators of Windows.
            name = prefix + info.filename.replace("\\", "/")
            if match := SCAN_TAIL.search(name):
                self._add(scans, int(match[1]), member)
            elif match := POSES_TAIL.search(name):
                self._add(poses, match[1], member)
            elif name.lower().endswith(".zip") and not prefix:
                nested.append(member)
        self._scans, self._poses = self._scans or scans, self._poses or poses
        for member in sorted(nested, key=_cost):
            if not (self._scans and self._poses):
                self._read_nested(member, outermost)

    def _container(self, file, prefix):
        """The ZIP ``file``, whose directory is read; ``prefix`` names it within the archive."""
        try:
            return zipfile.ZipFile(file)
        except DataError:
            raise
        # zipfile checks little of what a directory says: a wrong number may turn up anywhere.
        except (
            zipfile.BadZipFile,
            NotImplementedError,
            ValueError,
            OSError,
            struct.error,
        ) as error:
            raise DataError(
                f"{self._source}: {f'{prefix!r} in it' if prefix else 'it'} is not a whole ZIP"
                f" archive ({error}).",
                f"the file may be cut off; {BY_HAND}.",
            ) from None

    def _add(self, members, key, member):
        if key in members:
            raise DataError(
                f"{self._source}: {members[key].info.filename!r} and {member.info.filename!r} are"
                " both in the archive.",
                "extract the right one by hand and set `folder: {path: ...}`.",
            )
        members[key] = member

    def _read_nested(self, member, outermost):
        """Look into an archive within the archive: where it stands if stored, else unpacked."""
        prefix = member.info.filename[: -len(".zip")] + "/"
        self._inside += 1
        if self._inside > MAXIMUM_INSIDE:
            raise DataError(
                f"{self._source}: scans and poses are not in the first {MAXIMUM_INSIDE} of the"
                " archives within it; more are not looked into.",
                "extract it by hand and set `folder: {path: ...}`.",
            )
        what = f"{member.info.filename!r}, an archive within the archive,"
        self._require_plausible(member, what, MAXIMUM_NESTED - self._unpacked)
        if member.info.compress_type == zipfile.ZIP_STORED:
            outermost.seek(member.start)
            header = outermost.read(LOCAL_HEADER)
            # A member's bytes follow its header, its name and an extra field.
            lengths = [int.from_bytes(header[at : at + 2], "little") for at in (26, 28)]
            start = member.start + LOCAL_HEADER + sum(lengths)
            window = Window(outermost, start, member.info.file_size, self._source)
            self._read_directory(window, outermost, start, prefix)
            return
        self._unpacked += member.info.file_size
        path = self._cache / f"nested_{member.info.CRC:08x}_{member.info.file_size}.zip"
        if not path.is_file():
            say(
                f"{self._source}: {member.info.filename!r} is compressed as a whole, so all of it"
                f" ({amount(member.info.compress_size)}) is fetched, once"
            )
            require_space(self._cache, member.info.file_size + member.info.compress_size)
            self._extract(member, path, what, MAXIMUM_NESTED)
        file = _open_file(path, None)
        self._read_directory(file, file, 0, prefix)

    def _require_plausible(self, member, what, maximum):
        """Raise DataError if what the directory says of a member cannot be, or is too much."""
        info = member.info
        header = LOCAL_HEADER + len(info.orig_filename.encode())
        if info.file_size > maximum:
            problem = f"claims {info.file_size} bytes, at most {maximum} are accepted"
        elif member.start < 0 or member.start + header + info.compress_size > member.end:
            problem = "overlaps what stands behind it in the archive"
        elif info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            # Other methods can take any amount of memory, and nobody writes them.
            problem = f"cannot be decompressed (That compression method, {info.compress_type}, is"
            problem += " neither stored nor deflated)"
        elif stat.S_ISLNK(info.external_attr >> 16):
            problem = "is a symbolic link, expected a file"
        else:
            return
        raise DataError(
            f"{self._source}: {what} {problem}.",
            f"the archive is damaged or another one; {BY_HAND}.",
        )

    def _extract(self, member, destination, what, maximum):
        """Decompress a member to a file: whole and with the right CRC, or not at all."""
        self._require_plausible(member, what, maximum)
        require_space(Path(destination).parent, member.info.file_size)
        for _ in range(2):
            try:
                with (
                    self._transfer(member, what),
                    member.container.open(member.info) as source,
                    _atomic(Path(destination)) as target,
                ):
                    shutil.copyfileobj(source, target, CHUNK)
                    if target.tell() != member.info.file_size:
                        raise EOFError(f"{target.tell()} bytes, expected {member.info.file_size}")
                return
            except (zipfile.BadZipFile, zlib.error, EOFError) as error:
                problem = error
                say(f"{what}: damaged ({error})")
            except RuntimeError as error:  # encrypted, or a newer kind of archive
                raise DataError(
                    f"{self._source}: {what} cannot be decompressed ({error}).",
                    "extract the archive by hand and set `folder: {path: ...}`.",
                ) from None
            except OSError as error:
                raise DataError(
                    f"{destination}: {what} of {self._source} cannot be written or read"
                    f" ({error.strerror or error}).",
                    "check the permissions of both, and the disk.",
                ) from None
        raise DataError(
            f"{self._source}: {what} is damaged, read twice ({problem}).",
            f"the archive itself may be damaged; {BY_HAND}.",
        )

    def _transfer(self, member, what):
        if not member.remote:
            return contextlib.nullcontext()
        spool = self._cache / f"{member.remote.key}_{member.start}_{member.info.CRC:08x}.part"
        return member.remote.span(member.start, member.end, spool, what)


def _cost(nested):
    """Sort key: archives that can be read where they stand first, then those likely to be right."""
    likely = any(place in nested.info.filename for place in LEICA_PLACES)
    return nested.info.compress_type != zipfile.ZIP_STORED, not likely


@contextlib.contextmanager
def _atomic(path):
    """A file that gets the name ``path`` only when all of it is written."""
    temporary = path.with_name(path.name + ".part")
    try:
        with temporary.open("wb") as file:
            yield file
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
