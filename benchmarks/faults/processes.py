"""Processes that are killed while the workflow runs, and the same command once more."""

import os
import shutil
import signal
import subprocess
import time
from functools import partial

import numpy as np

from benchmarks.faults.outcome import Fault, Outcome, is_traceback, tail
from benchmarks.faults.workplace import SECONDS, Workplace

BEGUN = "Building DAG"  # what Snakemake says after it has read the Snakefile
ENDING = 3  # seconds within which jobs end after their run
WAYS = ("KILL", "TERM", "INT", "KILL of a job", "KILL of all")


def faults(campaign, number):
    """So many kills at random times of a run from nothing, in every way in turn."""
    generator = np.random.default_rng(campaign.seed)
    for k in range(number):
        way = WAYS[k % len(WAYS)]
        share = generator.uniform(0.1, 0.9)
        words = f"{way} after {share:.0%} of a run"
        yield Fault(words, partial(_killed, campaign, way, share, int(generator.integers(2**31))))


def _killed(campaign, way, share, seed):
    place = Workplace(campaign.folder / "killed")
    shutil.rmtree(place.folder, ignore_errors=True)
    place.folder.mkdir()
    # With their dates, which the plans carry.
    shutil.copytree(campaign.finished.folder / "scans", place.folder / "scans")
    place.configure(campaign.finished.config())
    process = place.start("--", *campaign.tables)
    time.sleep(share * campaign.seconds)
    _kill(place, process, way, seed)
    try:
        said, _ = process.communicate(timeout=SECONDS)
    except subprocess.TimeoutExpired:
        place.end_all()
        return Outcome("hang", f"it does not end after {way}")
    late = place.seconds_until_quiet(ENDING) is None
    place.end_all()
    if late:
        return Outcome("hang", f"jobs live {ENDING} s after their run")
    if way == "INT" and BEGUN in said and is_traceback(said):
        return Outcome("crash", tail(said))
    return _resumed(campaign, place, way)


def _kill(place, process, way, seed):
    if way == "INT":
        # To all processes of the terminal, as Ctrl-C does.
        os.killpg(process.pid, signal.SIGINT)
    elif way == "KILL of a job":
        jobs = [number for number in place.processes() if number != process.pid]
        if jobs:
            os.kill(jobs[seed % len(jobs)], signal.SIGKILL)
    elif way == "KILL of all":
        place.end_all()  # as a power cut does
    elif process.poll() is None:
        process.send_signal(getattr(signal, f"SIG{way}"))


def _resumed(campaign, place, way):
    """The same command once more; after kill -9 its error must say how to unlock."""
    code, said = place.run("--", *campaign.tables)
    if code and "unlock" in said:
        place.run("--unlock")
        code, said = place.run("--", *campaign.tables)
    if code != 0:
        return Outcome("crash" if code else "hang", f"does not go on after {way}: {said[-400:]}")
    return place.same_as(campaign.expected)
