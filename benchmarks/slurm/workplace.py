"""A folder in which the workflow runs through Slurm, and what Slurm says of its jobs."""

import datetime
import os
import re
import sys
from pathlib import Path
from typing import NamedTuple

from benchmarks.faults.workplace import CONFIG, REPOSITORY, Workplace
from benchmarks.slurm.cluster import asked

PROFILE = REPOSITORY / "profiles" / "slurm"
COLUMNS = "%i|%T|%V|%S|%e|%l|%k"


class SlurmJob(NamedTuple):
    """A job as squeue tells of it; times in seconds of the epoch, None where not known yet."""

    number: str
    state: str
    submitted: float
    started: float | None
    ended: float | None
    minutes: int  # its limit
    rule: str


def slurm_jobs():
    """All jobs that the controller knows of, ended ones too."""
    lines = asked("squeue", "-h", "--states=all", "-o", COLUMNS).splitlines()
    return [_slurm_job(*line.split("|")) for line in lines]


def _slurm_job(number, state, submitted, started, ended, limit, comment):
    rule = re.match(r"rule_(\w+?)(_wildcards_|$)", comment)
    times = map(_seconds, (submitted, started, ended))
    return SlurmJob(number, state, *times, _minutes(limit), rule[1] if rule else comment)


def _minutes(limit):
    """Of [[days-]hours:]minutes:seconds."""
    days, _, times = limit.rpartition("-")
    *hours, minutes, _ = map(int, times.split(":"))
    return 1440 * int(days or 0) + 60 * sum(hours) + minutes


def _seconds(time):
    try:
        return datetime.datetime.fromisoformat(time).timestamp()
    except ValueError:
        return None


class SlurmWorkplace(Workplace):
    """The same as a Workplace, whose runs go through Slurm by profiles/slurm."""

    seconds = 1800  # of a run: each job waits to be noticed

    def command(self, *arguments):
        snakefile = str(self.code / "Snakefile")
        command = [sys.executable, "-m", "snakemake", "--snakefile", snakefile]
        return [*command, "--configfile", CONFIG, "--profile", str(PROFILE), *arguments]

    def registering(self):
        """Numbers of the processes that register, in jobs of Slurm that run, by job."""
        found = {}
        for number in self.processes():
            try:
                command = Path(f"/proc/{number}/cmdline").read_bytes()
            except OSError:
                continue
            if re.search(rb"scripts/tmp\w+\.run_icp\.py\0$", command):
                found[job_of(number)] = number
        return found


def job_of(number):
    """The job of Slurm that a process belongs to; "" if none."""
    try:
        variables = Path(f"/proc/{number}/environ").read_bytes().split(b"\0")
    except OSError:
        return ""
    named = [value for value in variables if value.startswith(b"SLURM_JOB_ID=")]
    return named[0].partition(b"=")[2].decode() if named else ""


def cpu_seconds(number):
    """CPU seconds of a process so far, without those of its children."""
    try:
        words = Path(f"/proc/{number}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
