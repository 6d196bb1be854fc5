"""A stand-in for the data set's server: archives laid out like the real ones, served over HTTP on
this machine, counting every byte and misbehaving on demand."""

import contextlib
import gzip
import io
import random
import re
import threading
import time
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

HEADER = "Time_in_sec,x,y,z,Intensities,2DscanId,PointId"
POSE_HEADER = "poseId, timestamp, " + ", ".join(f"T{i}{j}" for i in range(4) for j in range(4))


def scan_csv(points):
    """The text of a ``Hokuyo_<i>.csv`` of points (n, 3)."""
    rows = [f"0.0,{x!r},{y!r},{z!r},-1,0,{k}" for k, (x, y, z) in enumerate(points.tolist())]
    return "\n".join([HEADER, *rows, ""])


def poses_csv(T_global_local):
    """The text of a ``pose_scanner_leica.csv`` of poses (n, 4, 4)."""
    rows = [
        f"{k}, {float(k)}, " + ", ".join(map(repr, T.ravel().tolist()))
        for k, T in enumerate(T_global_local)
    ]
    return "\n".join([POSE_HEADER, *rows, ""])


def write_folder(folder, scans, T_global_local, pose_place="leica"):
    """An extracted archive: scans, a list of (n, 3), and poses (n, 4, 4)."""
    for name, text in _members(scans, T_global_local, pose_place).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


def build_archive(scans, T_global_local, root="apartment", pose_place="leica", nested=None):
    """The bytes of an archive. ``nested``: None, "stored" or "deflated": a ZIP of each folder."""
    members = _members(scans, T_global_local, pose_place)
    outer = io.BytesIO()
    with zipfile.ZipFile(outer, "w", zipfile.ZIP_DEFLATED) as archive:
        # What the real ones hold besides, and nobody needs.
        archive.writestr(f"{root}/readme.txt", "A directory, global clouds, and more.\n")
        archive.writestr(
            f"{root}/csv_global/PointCloud0.csv", random.Random(0).randbytes(1_000_000)
        )
        archive.writestr(f"{root}/pictures.zip", b"not even a ZIP")
        if nested is None:
            for name, text in members.items():
                archive.writestr(f"{root}/{name}", text)
            return _finish(archive, outer)
        method = {"stored": zipfile.ZIP_STORED, "deflated": zipfile.ZIP_DEFLATED}[nested]
        for folder in dict.fromkeys(name.split("/")[0] for name in members):
            inner = io.BytesIO()
            with zipfile.ZipFile(inner, "w", zipfile.ZIP_DEFLATED) as inner_archive:
                for name, text in members.items():
                    if name.startswith(f"{folder}/"):
                        inner_archive.writestr(name.removeprefix(f"{folder}/"), text)
            archive.writestr(f"{root}/{folder}.zip", inner.getvalue(), compress_type=method)
        return _finish(archive, outer)


def _members(scans, T_global_local, pose_place):
    return {
        **{f"csv_local/Hokuyo_{index}.csv": scan_csv(scan) for index, scan in enumerate(scans)},
        f"{pose_place}/pose_scanner_leica.csv": poses_csv(T_global_local),
    }


def _finish(archive, file):
    archive.close()
    return file.getvalue()


class MisbehavingServer:
    """Serves ``content`` at ``url`` while the ``with`` statement lasts.

    ``faults``: one name (a method of the handler) for each request in turn, "" for none; after
    these, or from the start, every request suffers ``always``. ``ranges`` lists the requested
    (first, last) bytes, None without Range; ``bytes_sent`` counts body bytes.
    """

    def __init__(self, content, faults=(), always="", retry_after="0"):
        self.content, self.faults, self.always = content, list(faults), always
        self.retry_after = retry_after
        self.version = "first"
        self.ranges, self.user_agents, self.bytes_sent = [], set(), 0
        self.open_connections = self.most_connections = 0
        self.lock = threading.Lock()

    def __enter__(self):
        handler = type("Handler", (_Handler,), {"stand_in": self})
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.url = f"http://127.0.0.1:{self.server.server_port}/content"
        self.thread = threading.Thread(target=self.server.serve_forever, args=(0.01,), daemon=True)
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()

    def settle(self):
        """Wait until every connection is closed: a body may be sent after its reader has left."""
        deadline = time.monotonic() + 10
        while self.open_connections and time.monotonic() < deadline:
            time.sleep(0.01)

    def next_fault(self):
        with self.lock:
            return self.faults.pop(0) if self.faults else self.always


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def log_message(self, *arguments):
        pass

    def setup(self):
        super().setup()
        self._count_connection(1)

    def finish(self):
        self._count_connection(-1)
        super().finish()

    def _count_connection(self, change):
        stand_in = self.stand_in
        with stand_in.lock:
            stand_in.open_connections += change
            stand_in.most_connections = max(stand_in.most_connections, stand_in.open_connections)

    def do_GET(self):
        stand_in = self.stand_in
        match = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
        self.first, self.last = map(int, match.groups()) if match else (0, None)
        with stand_in.lock:
            stand_in.ranges.append((self.first, self.last) if match else None)
            stand_in.user_agents.add(self.headers["User-Agent"])
        if not self.headers["User-Agent"].startswith("icpshap/"):
            return self.forbidden()
        if fault := stand_in.next_fault():
            return getattr(self, fault)()
        return self._answer()

    # A good answer and its parts

    def _answer(self):
        if self.last is None:
            return self.ignore_range()
        body = self._body()
        self._head(206, len(body), self.first)
        return self._send(body)

    def _body(self):
        return self.stand_in.content[self.first : self.last + 1]

    def _head(self, status, length, first=None):
        self.send_response(status)
        self.send_header("ETag", f'"{self.stand_in.version}"')
        if length is not None:
            self.send_header("Content-Length", str(length))
        if first is not None:
            last, total = first + (length or len(self._body())) - 1, len(self.stand_in.content)
            self.send_header("Content-Range", f"bytes {first}-{last}/{total}")
        self.end_headers()

    def _send(self, body):
        with self.stand_in.lock:
            self.stand_in.bytes_sent += len(body)
        self.wfile.write(body)

    def _status(self, status, **headers):
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.send_header("Content-Length", "0")
        self.end_headers()

    # Faults

    def drop(self):
        """Close the connection in the middle of the body."""
        body = self._body()
        self._head(206, len(body), self.first)
        self._send(body[: len(body) // 2])
        self.close_connection = True

    def dribble(self):
        """Never more than 1,000 bytes a connection."""
        body = self._body()
        self._head(206, len(body), self.first)
        self._send(body[:1000])
        self.close_connection = True

    def truncate(self):
        """Half of the body, then a clean end: no length was announced."""
        self.close_connection = True
        self._head(206, None, self.first)
        self._send(self._body()[: len(self._body()) // 2])

    def stall(self):
        """Half of the body, then silence."""
        body = self._body()
        self._head(206, len(body), self.first)
        self._send(body[: len(body) // 2])
        time.sleep(1.0)
        self.close_connection = True

    def trickle(self):
        """One byte now and then, for longer than anyone waits."""
        self.close_connection = True
        self._head(206, len(self._body()), self.first)
        with contextlib.suppress(OSError):  # the reader has left
            for byte in self._body():
                self._send(bytes([byte]))
                time.sleep(0.02)

    def boast(self):
        """The right bytes where there are any, of a file of 10^18."""
        body = self._body()
        self.close_connection = True
        self.send_response(206)
        total = 10**18
        self.send_header("Content-Range", f"bytes {self.first}-{self.last}/{total}")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self._send(body)

    def inflate(self):
        """The whole file (HTTP 200), which a proxy has compressed, and a thousand times more."""
        self.close_connection = True
        body = gzip.compress(self.stand_in.content + bytes(10**7))
        self.send_response(200)
        self.send_header("ETag", '"first"')
        self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self._send(body)

    def ignore_range(self):
        """The whole file (HTTP 200)."""
        self._head(200, len(self.stand_in.content))
        self._send(self.stand_in.content)

    def drop_whole(self):
        """The first half of the whole file (HTTP 200)."""
        self._head(200, len(self.stand_in.content))
        self._send(self.stand_in.content[: len(self.stand_in.content) // 2])
        self.close_connection = True

    def restart(self):
        """A range, but one that starts again at 0."""
        length = self.last - self.first + 1
        self._head(206, length, 0)
        self._send(self.stand_in.content[:length])

    def overflow(self):
        """More bytes than asked for."""
        body = self._body() + b"more"
        self.close_connection = True
        self._head(206, None, self.first)
        self._send(body)

    def corrupt(self):
        """The right length, one wrong byte in the middle."""
        body = bytearray(self._body())
        body[len(body) // 2] ^= 0xFF
        self._head(206, len(body), self.first)
        self._send(bytes(body))

    def shift(self):
        """A range that starts one byte late."""
        self.first += 1
        self._answer()

    def compress(self):
        """The right bytes, compressed once more by a proxy."""
        body = gzip.compress(self._body())
        self.send_response(206)
        self.send_header("ETag", f'"{self.stand_in.version}"')
        total = len(self.stand_in.content)
        self.send_header("Content-Range", f"bytes {self.first}-{self.last}/{total}")
        self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self._send(body)

    def replace(self):
        """From now on another version of the file."""
        self.stand_in.version = "second"
        self._answer()

    def grow(self):
        """From now on a longer file."""
        self.stand_in.content += b"more"
        self._answer()

    def forbidden(self):
        self._status(403)

    def missing(self):
        self._status(404)

    def busy(self):
        self._status(503, Retry_After=self.stand_in.retry_after)

    def too_many(self):
        self._status(429, Retry_After=self.stand_in.retry_after)

    def redirect(self):
        """To an address that is neither https nor this machine's usual name."""
        self._status(302, Location=self.stand_in.url.replace("127.0.0.1", "127.0.0.2"))
