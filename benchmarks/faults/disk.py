"""Disks that are full or read-only, and folders that cannot be written.

A small file system in memory is mounted where that is allowed; elsewhere a limit on the size of a
file takes its place (`ulimit -f`), and read-only folders are left out.
"""

import os
import resource
import shutil
import subprocess
from contextlib import contextmanager
from functools import partial

from benchmarks.faults.outcome import Fault, of_call, said_of
from benchmarks.faults.workplace import Workplace
from icpshap import storage

PATHS = ("results/", "resources/", "No space left", "Read-only", "disk")


def faults_in_process(folder):
    """Tables written with too little room: the error names the file, and none is left half-made."""
    for path in sorted((folder / "results").rglob("*.parquet"))[:8]:
        for share in (0.0, 0.5, 0.98):
            words = f"{path.relative_to(folder)} written with {share:.0%} of the room it needs"
            yield Fault(words, partial(_write, path, share))


def _write(path, share):
    """The old file must be there to the bit, and no other be taken for it."""
    whole = path.read_bytes()
    table, about = storage.read(path)
    limit = int(share * len(whole))

    def write():
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, before[1]))
        try:
            storage.write(path, table, about)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    outcome = of_call(write, lambda _: False, path.name)
    if path.read_bytes() != whole:
        path.write_bytes(whole)
        return type(outcome)("wrong", "the old file is no longer whole")
    return outcome


def faults(campaign):
    """Runs of the workflow on a disk that fills up, is read-only, or has a file for a folder."""
    yield Fault("logs is a file", partial(_without_logs, campaign))
    if not can_mount(campaign.folder):
        return
    for room in (50, 400, 900):
        yield Fault(f"a disk with {room} kB left", partial(_full, campaign, room))
    yield Fault("results on a read-only disk", partial(_read_only, campaign, "results"))
    yield Fault("logs on a read-only disk", partial(_read_only, campaign, "logs"))
    yield Fault("resources on a read-only disk", partial(_read_only, campaign, "resources"))


def can_mount(folder):
    try:
        with _mounted(folder / "mount_test", "1m"):
            return True
    except (OSError, subprocess.CalledProcessError):
        return False


@contextmanager
def _mounted(folder, size):
    folder.mkdir(exist_ok=True)
    _call("mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder)
    try:
        yield
    finally:
        # Lazily: a process that is about to end may still have a file open.
        _call("umount", "-l", folder)


def _call(*command):
    subprocess.run(list(map(str, command)), check=True, capture_output=True, timeout=60)


def _without_logs(campaign):
    place = campaign.copy("disk")
    shutil.rmtree(place.folder / "logs")
    (place.folder / "logs").write_text("a file")
    _, said = place.run("--forcerun", "explain_sequence", "--", *campaign.tables)
    (place.folder / "logs").unlink()
    outcome = said_of(said, "logs")
    after = place.judged(campaign.expected)
    return outcome if after.kind == "right" else after


def _full(campaign, room):
    """Everything from nothing on a small disk; then there is room, and the same command goes on."""
    place = Workplace(campaign.folder / "full")
    shutil.rmtree(place.folder, ignore_errors=True)
    place.folder.mkdir()
    with _mounted(place.folder, "64m"):
        shutil.copytree(campaign.finished.folder / "scans", place.folder / "scans")
        place.configure(campaign.finished.config())
        ballast = place.folder / "ballast"
        free = os.statvfs(place.folder)
        ballast.write_bytes(bytes(free.f_bavail * free.f_frsize - room * 1000))
        code, said = place.run("--", *campaign.tables)
        place.end_all()
        ballast.unlink()
        outcome = said_of(said, *PATHS) if code else place.same_as(campaign.expected)
        if outcome.kind not in ("told", "right"):
            return outcome
        if place.run("--unlock")[0] is None:
            return type(outcome)("hang", "--unlock does not end")
        after = place.judged(campaign.expected)
        return outcome if after.kind == "right" else after


def _read_only(campaign, name):
    """A folder that can be read and not written, and afterwards can."""
    place = campaign.copy("disk")
    folder = place.folder / name
    with _mounted(folder, "64m"):
        shutil.copytree(campaign.finished.folder / name, folder, dirs_exist_ok=True)
        (folder / "tiny_fixed" / "own" / "shap.parquet").unlink(missing_ok=True)
        _call("mount", "-o", "remount,ro", folder)
        code, said = place.run("--forcerun", "read_scans", "--", *campaign.tables)
        _call("mount", "-o", "remount,rw", folder)
        outcome = said_of(said, *PATHS) if code else place.same_as(campaign.expected)
        if outcome.kind not in ("told", "right"):
            return outcome
        after = place.judged(campaign.expected)
        return outcome if after.kind == "right" else after
