"""A file on a web server as a seekable file, read by short, checked and repeated Range requests."""

from __future__ import annotations

import contextlib
import email.utils
import io
import os
import random
import re
import shutil
import sys
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, TextIO
from urllib.parse import urljoin, urlsplit

import requests
import urllib3

from icpshap.errors import DataError

# Servers refuse the names of common download libraries (HTTP 403).
USER_AGENT = "icpshap/1.0 (research on point cloud registration)"
TIMEOUT = (15, 60)  # s, to connect and between bytes
BLOCK = 2**21  # bytes a request within a span
SMALL_BLOCK = 2**16  # bytes a request elsewhere
CHUNK = 2**14  # bytes; a drop costs less than one
ATTEMPTS = 8  # requests for one block
FEW_ATTEMPTS = 3  # the same where it is soon clear that more are of no use
FIRST_DELAY = 1.0  # s, doubled with each attempt
MAXIMUM_DELAY = 120.0  # s
PATIENCE = 300.0  # s in which CHUNK bytes must arrive
# Bytes at once: a bound on the ZIP directory, the largest thing read so. An entry of it has a few
# hundred bytes, and takes a few times more in memory.
MAXIMUM_READ = 2**23


class DownloadError(DataError):
    """A file that could not be read from its server."""


class RangeIgnoredError(DownloadError):
    """The server keeps answering Range requests with the whole file."""


class _Fault(Exception):
    """A failed request that deserves another; ``wait`` [s] is what the server asked for."""

    attempts = ATTEMPTS

    def __init__(self, problem, wait=0.0):
        super().__init__(problem)
        self.wait = wait


class _Unreachable(_Fault):
    attempts = FEW_ATTEMPTS


class _RangeIgnored(_Fault):
    attempts = FEW_ATTEMPTS


class SeekableView(io.RawIOBase):
    """Read-only seekable bytes; a subclass gives ``name``, ``size`` and ``_read_at(start, size)``.

    ``name`` is what messages call it.
    """

    name: str | Path
    _position = 0

    @property
    def size(self) -> int:
        """Number of bytes."""
        raise NotImplementedError

    def _read_at(self, start, size):
        raise NotImplementedError

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._position

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        origin = {io.SEEK_SET: 0, io.SEEK_CUR: self._position, io.SEEK_END: self.size}[whence]
        if origin + offset < 0:
            raise OSError("seek before the start")
        self._position = origin + offset
        return self._position

    def read(self, size: int = -1) -> bytes:
        left = max(0, self.size - self._position)
        size = left if size < 0 else min(size, left)
        if size > MAXIMUM_READ:
            raise DataError(
                f"{self.name}: a table of {size} bytes is announced, at most {MAXIMUM_READ} are"
                " accepted.",
                "the archive is damaged or another one.",
            )
        data = self._read_at(self._position, size)
        self._position += len(data)
        return data


class Window(SeekableView):
    """The ``size`` bytes of ``file`` from ``start`` on, as a file of its own."""

    def __init__(
        self, file: BinaryIO | SeekableView, start: int, size: int, name: str | Path
    ) -> None:
        self._file, self._start, self._size, self.name = file, start, size, name

    @property
    def size(self) -> int:
        return self._size

    def _read_at(self, start, size):
        self._file.seek(self._start + start)
        return self._file.read(size)


class LocalFile(Window):
    """A file on disk, which is closed with it."""

    def __init__(self, path: Path) -> None:
        file = path.open("rb")
        super().__init__(file, 0, os.fstat(file.fileno()).st_size, path)

    def close(self) -> None:
        self._file.close()
        super().close()


class RemoteFile(SeekableView):
    """A file at an https ``url`` (or http on this machine); call `connect` before reading.

    ``alternatives`` ends the hints of errors: what a user can do without this server.
    ``received`` [bytes] and ``requests`` count what was transferred. Every method raises
    DownloadError, `connect` also RangeIgnoredError.
    """

    def __init__(
        self,
        url: str,
        alternatives: str,
        expected_bytes: int | None = None,
        terminal: TextIO | None = None,
    ) -> None:
        self.url = self.name = url
        self.received = 0
        self.requests = 0
        self._alternatives = alternatives
        self._expected_bytes = expected_bytes
        self._terminal = terminal
        self._progress: Progress | None = None
        self._identity: tuple[int, str] | None = None  # (bytes, version) of the first answer
        self._block_start, self._block = 0, b""
        self._span: tuple[int, int, Path] | None = None
        self._session = requests.Session()
        self._session.headers.update({"User-Agent": USER_AGENT, "Accept-Encoding": "identity"})

    def connect(self) -> None:
        """Ask for one byte: learn size and version, and whether the server serves ranges."""
        self._fetch(0, 1)

    @property
    def size(self) -> int:
        assert self._identity is not None, "connect first"
        return self._identity[0]

    @property
    def key(self) -> str:
        """Names this version of the file: pieces of another one are of no use."""
        return f"{zlib.crc32(repr((self.url, self._identity)).encode()):08x}"

    def close(self) -> None:
        self._session.close()
        super().close()

    @contextlib.contextmanager
    def span(self, start: int, end: int, spool: Path, what: str) -> Iterator[None]:
        """While this lasts, read [start, end) once, from its start to its end, in large blocks.

        They are kept in the file ``spool``: what an interrupted run left there is not asked for
        again. An exception that is no transfer's removes it, like success.
        """
        self._span = (start, end, spool)
        self._progress = progress = Progress(what, end - start, self._terminal)
        try:
            yield
            progress.finish()
        except (DownloadError, OSError):
            raise
        except Exception:
            spool.unlink(missing_ok=True)
            raise
        else:
            spool.unlink(missing_ok=True)
        finally:
            self._span = self._progress = None
            self._block = b""

    def download(self, path: Path, verify: Callable[[Path], None]) -> None:
        """Write the whole file to ``path``, for servers that ignore Range: one long request.

        ``verify(temporary path)`` may raise before the file gets its name.
        """
        part = path.with_name(path.name + ".part")

        def attempt():
            with self._get({}) as response, part.open("wb") as file:
                self._check_status(response, 200)
                length = response.headers.get("Content-Length", "")
                if not length.isdecimal():
                    raise _Fault("the server does not say how long the file is")
                self._check_identity(int(length), response)
                require_space(path.parent, self.size)
                self._progress = Progress(path.name, self.size, self._terminal)
                left = self.size
                for chunk in _arriving(response):
                    self._count(chunk)
                    left -= len(chunk)
                    if left < 0:  # decompressed, it may be any number
                        raise _Fault(f"more than the announced {self.size} bytes arrived")
                    file.write(chunk)
            if part.stat().st_size != self.size:
                raise _Fault(f"{part.stat().st_size} bytes of {self.size} arrived")

        self._repeat(attempt, "the whole file")
        if self._progress is not None:
            self._progress.finish()
        verify(part)
        part.replace(path)

    # Blocks

    def _read_at(self, start, size):
        data = bytearray()
        while len(data) < size:
            position = start + len(data)
            if not self._block_start <= position < self._block_start + len(self._block):
                self._load(position)
            offset = position - self._block_start
            data += self._block[offset : offset + size - len(data)]
        return bytes(data)

    def _load(self, position):
        """Make the current block one that holds ``position``."""
        if self._span and self._span[0] <= position < self._span[1]:
            self._block_start, self._block = position, self._read_span(position, *self._span)
        else:
            # Aligned, so that the end of a ZIP directory brings along what precedes it.
            start = position - position % SMALL_BLOCK
            self._block = self._fetch(start, min(start + SMALL_BLOCK, self.size))
            self._block_start = start

    def _read_span(self, position, start, end, spool):
        with spool.open("a+b") as file:
            file.seek(position - start)
            if block := file.read(BLOCK):
                if self._progress:
                    self._progress.resume(len(block))
            else:
                block = self._fetch(position, min(position + BLOCK, end))
                file.write(block)
        return block

    def _fetch(self, start, end):
        """The bytes [start, end), with as many requests as that takes."""
        data = bytearray()

        def attempt():
            for chunk in self._request_range(start + len(data), end):
                self._count(chunk)
                data.extend(chunk)
            if len(data) != end - start:
                raise _Fault(f"{len(data)} bytes of {end - start} arrived")

        self._repeat(attempt, f"bytes {start}-{end - 1}", lambda: len(data))
        return bytes(data)

    # Requests

    def _request_range(self, start, end):
        with self._get({"Range": f"bytes={start}-{end - 1}"}) as response:
            if response.status_code == 200:
                raise _RangeIgnored("the server sends the whole file, not the range (HTTP 200)")
            self._check_status(response, 206)
            content_range = response.headers.get("Content-Range", "")
            match = re.fullmatch(r"bytes (\d+)-(\d+)/(\d+)", content_range)
            if not match or int(match[1]) != start or not start <= int(match[2]) < end:
                raise _Fault(f"asked for bytes {start}-{end - 1}, got {content_range!r}")
            self._check_identity(int(match[3]), response)
            left = int(match[2]) + 1 - start
            for chunk in _arriving(response):
                yield chunk[:left]
                left -= len(chunk)
                if left < 0:  # more than announced
                    return

    def _get(self, headers):
        self._require_secure(self.url)
        self.requests += 1
        return self._session.get(
            self.url,
            headers=headers,
            stream=True,
            timeout=TIMEOUT,
            hooks={"response": self._check_redirect},
        )

    def _check_redirect(self, response, **_):
        if target := self._session.get_redirect_target(response):
            self._require_secure(urljoin(response.url, target))

    def _require_secure(self, url):
        parts = urlsplit(url)
        if parts.scheme != "https" and parts.hostname not in ("127.0.0.1", "::1", "localhost"):
            raise self._error(f"{url} is not an https address.", "use https.")

    def _check_status(self, response, expected):
        status = f"HTTP {response.status_code} {response.reason}"
        if response.status_code in (408, 429, 500, 502, 503, 504):
            raise _Fault(status, _retry_after(response.headers.get("Retry-After", "")))
        if response.status_code == 403:
            raise self._error(
                f"{status}: the server refuses the request.",
                f"it refuses some User-Agents (sent: {USER_AGENT!r}; a proxy may change it).",
            )
        if response.status_code != expected:
            raise self._error(f"{status}.", "the address may have changed.")

    def _check_identity(self, size, response):
        """Size as configured, size and version as in the first answer."""
        version = response.headers.get("ETag") or response.headers.get("Last-Modified")
        if self._identity is None:
            if self._expected_bytes not in (None, size):
                raise self._error(
                    f"the file has {size} bytes, but the configuration says"
                    f" `bytes: {self._expected_bytes}`.",
                    "if it was replaced on purpose, correct `bytes`.",
                )
            self._identity = (size, version)
        elif self._identity != (size, version):
            raise self._error(
                f"the file changed while it was read: bytes and version were {self._identity},"
                f" are {(size, version)}.",
                "run the same command again; no piece of the old file will be used.",
            )

    def _count(self, chunk):
        self.received += len(chunk)
        if self._progress:
            self._progress.add(len(chunk))

    def _repeat(self, attempt, what, progress=lambda: 0):
        """Call ``attempt`` until it succeeds, waiting longer the less is achieved."""
        faults: Counter[type[_Fault]] = Counter()
        reached = 0
        while True:
            try:
                return attempt()
            except (requests.RequestException, urllib3.exceptions.HTTPError) as error:
                kind = _Fault if self._identity else _Unreachable
                fault = kind(_root_cause(error))
            except _Fault as error:
                fault = error
            if progress() - reached >= CHUNK:
                faults, reached = Counter(), progress()
            faults[type(fault)] += 1
            if faults[type(fault)] >= fault.attempts or faults.total() >= ATTEMPTS:
                break
            if fault.wait > MAXIMUM_DELAY:
                raise self._error(
                    f"{what}: {fault}, the server asks to wait {fault.wait:.0f} s.",
                    "run the same command again later.",
                )
            delay = min(FIRST_DELAY * 2 ** (faults.total() - 1), MAXIMUM_DELAY)
            say(f"{what}: {fault}; attempt {faults.total() + 1} follows")
            time.sleep(max(delay * random.uniform(0.5, 1.5), fault.wait))
        raise self._error(
            f"{what}: {faults.total()} attempts failed, the last one with: {fault}.",
            "check the network (a proxy is taken from HTTPS_PROXY)."
            if isinstance(fault, _Unreachable)
            else "run the same command again; it continues where this one stopped.",
            RangeIgnoredError if isinstance(fault, _RangeIgnored) else DownloadError,
        )

    def _error(self, problem, hint, kind=DownloadError):
        tried = f"{self.requests} requests, {self.received} bytes received"
        return kind(f"{self.url} ({tried})\n{problem}", f"{hint}\n{self._alternatives}")


def _arriving(response):
    """The pieces of a body as they arrive, decompressed, of at most CHUNK bytes each.

    Raises _Fault where less than CHUNK bytes arrive in PATIENCE seconds: a byte now and then would
    keep the connection from timing out for ever.
    """
    start, arrived = time.monotonic(), 0
    while chunk := response.raw.read1(CHUNK, decode_content=True):
        yield chunk
        arrived += len(chunk)
        if arrived >= CHUNK:
            start, arrived = time.monotonic(), 0
        elif time.monotonic() - start > PATIENCE:
            raise _Fault(f"{arrived} bytes arrived in {PATIENCE:.0f} s")


def _retry_after(value):
    """Seconds to wait according to a Retry-After header: a number or a date."""
    if value.isdecimal():
        return float(value)
    try:
        moment = email.utils.parsedate_to_datetime(value).astimezone(UTC)
    except ValueError:
        return 0.0
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())


def _root_cause(error):
    """What lies at the bottom of an exception of requests, in words."""
    while error.args and isinstance(error.args[-1], Exception):
        error = error.args[-1]
    cause = str(getattr(error, "reason", None) or error)
    return re.sub(r"^.*object at 0x\w+>: |^\w+\(.*?\): ", "", cause)


def require_space(folder: Path, size: int) -> None:
    """Raise DataError unless the disk of a folder has room for ``size`` bytes."""
    free = shutil.disk_usage(folder).free
    if free < size:
        raise DataError(
            f"{folder}: {amount(size)} are needed, {amount(free)} are free.",
            "make room on this disk.",
        )


# Reports

CLEAR_LINE = "\r\033[K"


def say(text: str) -> None:
    """A line of the log; on a terminal it takes the place of the moving line."""
    clear = CLEAR_LINE if sys.stderr.isatty() else ""
    print(clear + text, file=sys.stderr, flush=True)


def amount(size: float) -> str:
    """A number of bytes in words."""
    return f"{size / 1e6:,.1f} MB" if size >= 1e6 else f"{size / 1e3:,.1f} kB"


class Progress:
    """Reports a transfer of ``total`` bytes: its amount, rate and time left.

    One moving line on ``terminal``, a text stream, or on standard error, whichever is a terminal;
    plain lines on standard error if that is none, the first after ten seconds.
    """

    MOVE, LINE = 0.2, 10.0  # s between reports

    def __init__(self, what: str, total: int, terminal: TextIO | None = None) -> None:
        self._what, self._total = what, total
        streams = [stream for stream in (terminal, sys.stderr) if stream and stream.isatty()]
        self._terminal = streams[0] if streams else None
        self._lines = not sys.stderr.isatty()
        self._done = self._resumed = 0
        self._start = self._moved = self._printed = time.monotonic()

    def resume(self, size: int) -> None:
        """Count bytes that were there already."""
        self._done += size
        self._resumed += size

    def add(self, size: int) -> None:
        """Count bytes that arrived."""
        self._done += size
        now = time.monotonic()
        if self._terminal and now - self._moved >= self.MOVE:
            self._moved = now
            print(CLEAR_LINE + self._text(now), end="", file=self._terminal, flush=True)
        if self._lines and now - self._printed >= self.LINE:
            self._printed = now
            say(self._text(now))

    def finish(self) -> None:
        if self._terminal:
            print(CLEAR_LINE, end="", file=self._terminal, flush=True)
        seconds = time.monotonic() - self._start
        resumed = f", {amount(self._resumed)} of it earlier" if self._resumed else ""
        say(f"{self._what}: {amount(self._done)} in {seconds:.1f} s{resumed}")

    def _text(self, now):
        rate = (self._done - self._resumed) / max(now - self._start, 1e-3)
        left = (self._total - self._done) / max(rate, 1.0)
        return (
            f"{self._what}: {amount(self._done)} of {amount(self._total)},"
            f" {amount(rate)}/s, {left:.0f} s left"
        )
