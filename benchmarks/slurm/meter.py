"""What the jobs of a run cost besides what they are for: time on their node, and CPU seconds.

Slurm without accounting does not say; the operating system does, of every process that lives.
"""

import re
import threading
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

from benchmarks.slurm.workplace import cpu_seconds, job_of, slurm_jobs

SECONDS = 0.2  # between two looks; so much of a process's end is missed
SCRIPT = re.compile(rb"scripts/tmp\w+\.\w+\.py\0$")


class Seen:
    """What was seen of a process: the job it belongs to, its first and last time, CPU seconds."""

    def __init__(self, number):
        self.job = job_of(number)
        self.first = time.time()
        self.look(number)

    def look(self, number):
        self.last = time.time()
        self.cpu = cpu_seconds(number) or getattr(self, "cpu", 0.0)
        # A shell becomes the program that it starts.
        self.is_script = bool(SCRIPT.search(_command(number))) or getattr(self, "is_script", False)


class JobCost(NamedTuple):
    """Seconds of a job: on its node, and of that and of the CPU what its script took."""

    rule: str
    seconds: float
    script_seconds: float
    cpu: float
    script_cpu: float

    @property
    def overhead(self):
        return max(self.seconds - self.script_seconds, 0.0)

    @property
    def cpu_overhead(self):
        return self.cpu - self.script_cpu


class Meter:
    """Context in which the processes of a workplace are looked at again and again."""

    def __init__(self, place):
        self.place = place
        self.seen = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()

    def _look(self):
        while not self._over.wait(SECONDS):
            for number in self.place.processes():
                if number in self.seen:
                    self.seen[number].look(number)
                else:
                    self.seen[number] = Seen(number)

    def costs(self):
        """A `JobCost` of every job of Slurm that has ended, of those whose script was seen."""
        found = []
        for job in slurm_jobs():
            of_job = [seen for seen in self.seen.values() if seen.job == job.number]
            scripts = [seen for seen in of_job if seen.is_script]
            if job.state == "COMPLETED" and scripts:
                found.append(
                    JobCost(
                        job.rule,
                        job.ended - job.started,
                        max(seen.last for seen in scripts) - min(seen.first for seen in scripts),
                        sum(seen.cpu for seen in of_job),
                        sum(seen.cpu for seen in scripts),
                    )
                )
        return found


def _command(number):
    try:
        return Path(f"/proc/{number}/cmdline").read_bytes()
    except OSError:
        return b""


def by_rule(costs):
    """Rows of a table: what jobs of each rule cost, medians."""
    rows = []
    for rule in [*sorted({cost.rule for cost in costs}), "all"]:
        of_rule = [cost for cost in costs if rule in (cost.rule, "all")]
        rows.append(
            {
                "rule": rule,
                "jobs": len(of_rule),
                "on the node, s": median(cost.seconds for cost in of_rule),
                "of these the script": median(cost.script_seconds for cost in of_rule),
                "CPU, s": median(cost.cpu for cost in of_rule),
                "of these the script's": median(cost.script_cpu for cost in of_rule),
            }
        )
    return rows
