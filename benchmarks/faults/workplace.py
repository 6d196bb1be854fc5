"""A folder in which the workflow runs as a user runs it, and what can be asked of it."""

import os
import shutil
import signal
import subprocess
import sys
import time
from hashlib import sha256
from pathlib import Path

import numpy as np
import yaml

from benchmarks.faults.outcome import RIGHT, Outcome, is_traceback, said_of
from icpshap.jobs.start import OF_EXPLANATION

REPOSITORY = Path(__file__).parent.parent.parent
TINY = REPOSITORY / "tests" / "tiny.yaml"
CONFIG = "tiny.yaml"
MARK = "ICPSHAP_FAULTS"  # by which the processes of a run are found, whoever their parent is
SECONDS = 600  # of a run of the workflow, on a busy machine
TABLES = tuple(
    f"results/{experiment}/{table}.parquet"
    for experiment in ("tiny_fixed", "tiny_pose")
    for table in OF_EXPLANATION
)


class Workplace:
    """A working directory with a configuration; the code is the repository's or a copy of it."""

    tables = TABLES
    seconds = SECONDS

    def __init__(self, folder, code=REPOSITORY):
        self.folder = Path(folder)
        self.code = Path(code)

    @classmethod
    def new(cls, folder, config=None):
        """A new one with the configuration of `scans_of_own`, or another."""
        place = cls(folder)
        place.folder.mkdir(parents=True)
        write_scans(place.folder / "scans")
        place.configure(config or scans_of_own())
        return place

    def copy(self, folder):
        """The same elsewhere, with all dates."""
        shutil.copytree(self.folder, folder, symlinks=True)
        return type(self)(folder, self.code)

    def configure(self, config):
        text = yaml.safe_dump(config, sort_keys=False)
        (self.folder / CONFIG).write_text(text, encoding="utf-8")

    def config(self):
        return yaml.safe_load((self.folder / CONFIG).read_text(encoding="utf-8"))

    def command(self, *arguments, cores=2):
        snakefile = str(self.code / "Snakefile")
        command = [sys.executable, "-m", "snakemake", f"-j{cores}", "--snakefile", snakefile]
        return [*command, "--configfile", CONFIG, *arguments]

    def start(self, *arguments, **variables):
        """The workflow, started in a session of its own; its output goes into a pipe."""
        return subprocess.Popen(
            self.command(*arguments),
            cwd=self.folder,
            env=self.environment(**variables),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
        )

    def environment(self, **variables):
        fixed = {"PYTHONDONTWRITEBYTECODE": "1", MARK: str(self.folder.resolve())}
        compiled = os.environ.get("NUMBA_CACHE_DIR", str(REPOSITORY / ".cache" / "numba"))
        return {**os.environ, "NUMBA_CACHE_DIR": compiled, **fixed, **variables}

    def run(self, *arguments, **variables):
        """(exit code or None where it hung, all that it said)."""
        process = self.start(*arguments, **variables)
        try:
            said, _ = process.communicate(timeout=self.seconds)
        except subprocess.TimeoutExpired:
            self.end_all()
            return None, process.communicate()[0]
        return process.returncode, said

    def processes(self):
        """Numbers of the live processes of this workplace."""
        return [int(path.name) for path in Path("/proc").glob("[0-9]*") if self._is_ours(path)]

    def _is_ours(self, path):
        try:
            if (path / "stat").read_text().rpartition(")")[2].split()[0] == "Z":
                return False
            found = (path / "environ").read_bytes().split(b"\0")
        except OSError:  # it has just ended, or is another user's
            return False
        return f"{MARK}={self.folder.resolve()}".encode() in found

    def end_all(self):
        for number in self.processes():
            try:
                os.kill(number, signal.SIGKILL)
            except ProcessLookupError:
                continue

    def seconds_until_quiet(self, limit):
        """Seconds until no process is left; None if some are after the limit."""
        began = time.monotonic()
        while self.processes():
            if time.monotonic() - began > limit:
                return None
            time.sleep(0.05)
        return time.monotonic() - began

    def bytes(self):
        """Digest of every parquet file by its path."""
        files = [
            path
            for top in ("resources", "results")
            for path in sorted((self.folder / top).rglob("*.parquet"))
        ]
        return {
            str(path.relative_to(self.folder)): sha256(path.read_bytes()).hexdigest()
            for path in files
        }

    def same_as(self, expected):
        """Right if the tables are there and every file that is has the bytes that are expected.

        Files between sources and tables may be missing: nothing is made again for their sake.
        """
        found = self.bytes()
        others = [path for path in expected if found.get(path, expected[path]) != expected[path]]
        others += [path for path in TABLES if path not in found]
        return RIGHT if not others else Outcome("wrong", f"other bytes: {', '.join(others[:3])}")

    def judged(self, expected, *names, arguments=(), removed=(), **variables):
        """The outcome of a run: the expected bytes, or an error that says any of the names.

        removed: files that the hint of the error says to remove; the run after it must be right.
        """
        code, said = self.run(*arguments, "--", *TABLES, **variables)
        if code is None:
            return Outcome("hang", f"more than {SECONDS} s")
        if is_traceback(said):
            return said_of(said)
        if code == 0:
            return self.same_as(expected)
        outcome = said_of(said, *names)
        if outcome.kind != "told":
            return outcome
        for path in removed:
            (self.folder / path).unlink(missing_ok=True)
        code, said = self.run("--", *TABLES)
        if code != 0:
            return Outcome("crash", f"does not go on: {said[-300:]}")
        after = self.same_as(expected)
        return outcome if after.kind == "right" else after


def scans_of_own():
    """tiny.yaml with a folder of three scans and a simulated scene; two experiments, no figures."""
    config = yaml.safe_load(TINY.read_text(encoding="utf-8"))
    config["data"] = {
        "own": {"title": "Own", "scans": 3, "folder": {"path": "scans"}},
        "tiny_room": config["data"]["tiny_room"],
    }
    fixed, pose = (config["experiments"][name] for name in ("tiny_fixed", "tiny_pose"))
    fixed |= {"sequences": ["own"], "figures": []}
    pose |= {"pairs": [{"sequence": "tiny_room", "reference": 0, "source": 1}], "figures": []}
    config["experiments"] = {"tiny_fixed": fixed, "tiny_pose": pose}
    return {**config, "sequences": ["own", "tiny_room"], "run": ["tiny_fixed", "tiny_pose"]}


def write_scans(folder, seed=0, number=3):
    """Scans of the corner of a room as CSV, with the poses of a scanner that moves along it."""
    folder.mkdir()
    generator = np.random.default_rng(seed)
    poses = []
    for index in range(number):
        points = generator.uniform([1.5, 1.5, 1.2], [5.0, 4.0, 3.5], (1500, 3))
        wall = generator.integers(0, 3, len(points))
        points[np.arange(len(points)), wall] = np.array([5.0, 4.0, 3.5])[wall]
        points[:, 0] -= 0.1 * index
        text = "\n".join(",".join(f"{value:.4f}" for value in row) for row in points)
        (folder / f"s{index}.csv").write_text(f"x,y,z\n{text}\n", encoding="utf-8")
        poses.append(f"1 0 0 {0.1 * index:.1f} 0 1 0 0 0 0 1 0")
    (folder / "poses.txt").write_text("\n".join(poses) + "\n", encoding="utf-8")
