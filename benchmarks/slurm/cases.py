"""What may happen to jobs on a cluster, and whether the same bytes come of it.

Every case begins at a workplace whose pairs are checked and whose registrations are missing, lets
the workflow make them through Slurm, and disturbs it while one of them runs. Where the run itself
does not get over it, the same command has to.
"""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from typing import NamedTuple

from benchmarks.faults.workplace import Workplace, scans_of_own
from benchmarks.slurm.cluster import Cluster, asked
from benchmarks.slurm.workplace import SlurmWorkplace, job_of, slurm_jobs
from icpshap.errors import UserError

RUNS_PER_JOB = 600  # two jobs, of two pairs
SECONDS = 300  # until something is to have happened
QUEUE = 1  # job that a full queue holds
ENDED_LONG_AGO = 20  # seconds after which it forgets an ended job; the plug-in wants 15 at least


class Case(NamedTuple):
    """What happens, by a function of a `Disturbed`, and arguments of the workflow's command."""

    words: str
    happens: Callable
    arguments: tuple = ()
    options: dict | None = None  # of a cluster of its own


class Result(NamedTuple):
    """What came of a case; `by`: what went on, the run itself or the same command once more."""

    words: str
    by: str
    equal: bool
    seconds: float


class Disturbed:
    """A run through Slurm that is about to be disturbed."""

    def __init__(self, place, cluster, arguments):
        self.place = place
        self.cluster = cluster
        self.known = {job.number for job in slurm_jobs()}
        self.process = place.start(*arguments)

    def jobs(self):
        """Its jobs."""
        return [job for job in slurm_jobs() if job.number not in self.known]

    def registering(self):
        """Job and process of a registration, as soon as one runs."""
        return next(iter(self.until(self.place.registering).items()))

    def until(self, found):
        """What a function returns, as soon as that is something. Raises TimeoutError."""
        began = time.monotonic()
        while time.monotonic() - began < SECONDS:
            if result := found():
                return result
            time.sleep(0.1)
        raise TimeoutError(f"{found.__name__}: nothing in {SECONDS} s")

    def until_ended_as(self, number, state):
        """Wait until a job has ended in a state."""

        def is_so():
            return any(job.number == number and job.state == state for job in slurm_jobs())

        self.until(is_so)

    def interrupt(self):
        """Ctrl-C of the run; its jobs are to end with it."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(SECONDS)
        self.until(lambda: not asked("squeue", "-h"))

    def end(self):
        """The exit code of the run."""
        self.process.communicate(timeout=SECONDS)
        return self.process.returncode


# --- what happens ---------------------------------------------------------------------------------


def nothing(run):
    pass


def cancelled(run):
    number, _ = run.registering()
    asked("scancel", number)


def killed(run):
    _, process = run.registering()
    os.kill(process, signal.SIGKILL)


def hangs_beyond_its_limit(run):
    """The limit of the job becomes a minute; of the next attempt it is twice that of the rule."""
    number, process = run.registering()
    os.kill(process, signal.SIGSTOP)
    (limit,) = (job.minutes for job in run.jobs() if job.number == number)
    asked("scontrol", "update", f"JobId={number}", "TimeLimit=1")
    run.until_ended_as(number, "TIMEOUT")
    run.until(lambda: any(job.minutes == 2 * limit for job in run.jobs()))


def node_down_and_back(run):
    run.registering()
    node = f"NodeName={run.cluster.node}"
    asked("scontrol", "update", node, "State=DOWN", "Reason=benchmark")
    run.until(lambda: not run.place.registering())
    run.cluster.wait_until("down", "down*")
    asked("scontrol", "update", node, "State=RESUME")


def power_cut_of_node(run):
    run.registering()
    run.cluster.lose_node([number for number in run.place.processes() if job_of(number)])
    run.cluster.start_node()


def run_is_stopped(run):
    run.registering()
    run.interrupt()


def run_is_killed(run):
    """The jobs run on; how far they are when the same command begins, the machine decides."""
    run.registering()
    run.process.kill()
    run.process.wait()
    code, said = run.place.run("--unlock")
    assert code == 0, said


CASES = (
    Case("a job is cancelled (scancel)", cancelled),
    Case("a job's process is killed (kill -9)", killed),
    Case("the same, and nothing is tried again", killed, ("--retries", "0")),
    Case("a job hangs until its time is over", hangs_beyond_its_limit),
    Case("the node is set down, and resumed", node_down_and_back),
    Case("the node loses power, and comes back", power_cut_of_node),
    Case("Ctrl-C", run_is_stopped),
    Case("the run is killed (kill -9), its jobs run on", run_is_killed),
    Case(
        f"the queue takes {QUEUE} job, and refuses others",
        nothing,
        options={"MaxJobCount": QUEUE + 1, "MinJobAge": ENDED_LONG_AGO},
    ),
)


# --- what comes of it -----------------------------------------------------------------------------


class Prepared(NamedTuple):
    """A workplace without its registrations; the bytes of all files, and paths that are missing."""

    place: SlurmWorkplace
    expected: dict
    missing: list


def prepared(folder):
    """`Prepared` in a new folder, made without Slurm."""
    config = scans_of_own()
    config |= {"sequences": ["own"], "run": ["tiny_fixed"], "runs_per_job": RUNS_PER_JOB}
    code, said = Workplace.new(folder, config).run()
    assert code == 0, said
    place = SlurmWorkplace(folder)
    expected = place.bytes()
    missing = [path for path in expected if "/runs/" in path]
    for path in missing:
        (place.folder / path).unlink()
    return Prepared(place, expected, missing)


def tried(case, cluster, start, folder):
    """The `Result` of a case on a cluster; folder: a new one to work in."""
    began = time.monotonic()
    place = start.place.copy(folder)
    arguments = (*case.arguments, "--", *start.missing)
    run = Disturbed(place, cluster, arguments)
    by = "the run itself"
    try:
        case.happens(run)
        if run.end() != 0:
            by = "the same command"
            code, said = place.run(*arguments)
            assert code == 0, said
    except (AssertionError, OSError, subprocess.SubprocessError, UserError) as error:
        by = f"nothing: {error}"
    finally:
        place.end_all()
    return Result(case.words, by, place.bytes() == start.expected, time.monotonic() - began)


def all_tried(cluster, folder):
    """Yields the `Result` of every case; those that need another cluster come last."""
    start = prepared(folder / "prepared")
    for number, case in enumerate(CASES):
        if not case.options:
            yield tried(case, cluster, start, folder / str(number))


def all_tried_elsewhere(folder):
    """The same of cases with a cluster of their own, which no other may be beside."""
    start = prepared(folder / "prepared_elsewhere")
    for number, case in enumerate(CASES):
        if case.options:
            with Cluster(**case.options) as cluster:
                yield tried(case, cluster, start, folder / str(number))
