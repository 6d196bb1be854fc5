"""What a person sees while the workflow runs: a line per finished job, and the time left."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, TextIO, TypeVar

from icpshap.errors import UserError

Item = TypeVar("Item")
Done = TypeVar("Done")

# What these events of snakemake say, the lines of this module say shorter; its log file keeps them.
REPLACED = {
    "workflow_started",
    "job_info",
    "job_started",
    "job_finished",
    "progress",
    "resources_info",
}
SECONDS = 10  # between two lines of a job's log that say how far it is
CHATTER = ("Select jobs to execute", "Execute ")


def replace_job_lines(
    logger: logging.Logger,
    progress: Progress,
    is_dry_run: Callable[[], bool],
    is_stopped: Callable[[], bool],
) -> None:
    """Let `progress` say on the terminal what `logger`'s own handler would say of jobs.

    A dry run (known only once the workflow is set up) keeps snakemake's lines, which give reasons.
    Of a run that was stopped nothing is said but that: its jobs failed since they were stopped.
    """

    def is_shown(record):
        if is_stopped() and record.levelno > logging.INFO:
            return record.msg == STOPPED
        return is_dry_run() or not is_replaced(record)

    for handler in logger.handlers:
        if not isinstance(handler, logging.FileHandler):
            handler.addFilter(is_shown)
    progress.addFilter(lambda record: not is_dry_run())
    logger.addHandler(progress)


def is_replaced(record: logging.LogRecord) -> bool:
    """Whether a record only says that a job starts or ends; plans and errors do not."""
    if record.levelno > logging.INFO:
        return False
    return getattr(record, "event", None) in REPLACED or str(record.msg).startswith(CHATTER)


class Progress(logging.Handler):
    """Turns snakemake's events into a line for every finished job.

    `failed` holds the logs of jobs that failed. terminal: where lines go; planned(): the settings
    and runs of the jobs that will run; settings_and_runs(wildcards): those of one job; estimating:
    names of the rules whose jobs these are. What a run is differs between kinds of estimators, and
    some have none in the sense of ICP: runs only tell how much is left.
    """

    def __init__(
        self,
        terminal: TextIO,
        planned: Callable[[], tuple[int, int]],
        settings_and_runs: Callable[[Any], tuple[int, int]],
        estimating: Collection[str],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self.terminal = terminal
        self.planned = planned
        self.settings_and_runs = settings_and_runs
        self.estimating = estimating
        self.clock = clock
        self.jobs: dict[int, tuple[str, Any]] = {}
        self.failed: list[str] = []
        self.finished = self.total = self.settings = self.runs = 0
        self.started: float | None = None  # once the first of them runs

    def emit(self, record: Any) -> None:  # with what snakemake adds to a record
        event = getattr(record, "event", None)
        if event == "run_info":
            self.total = record.stats["total"]
            self.planned_settings, self.planned_runs = self.planned()
        elif event == "job_info":
            self.jobs[record.jobid] = (record.rule_name, record.wildcards)
            if record.rule_name in self.estimating and self.started is None:
                self.started = self.clock()
        elif event == "job_error":
            self.failed += record.log
        elif event == "job_finished":
            self.finished += 1
            rule, wildcards = self.jobs.get(record.job_id, ("all", {}))
            if rule != "all":
                print(self.line(rule, wildcards), file=self.terminal, flush=True)

    def line(self, rule: str, wildcards: Any) -> str:
        """What is said of a job that has just finished."""
        count = f"[{self.finished:>{len(str(self.total))}}/{self.total}]"
        text = f"{count} {rule} {' '.join(map(str, wildcards.values()))}"
        if rule not in self.estimating:
            return text
        settings, runs = self.settings_and_runs(wildcards)
        self.settings += settings
        self.runs += runs
        now = self.clock()
        rate = self.runs / max(now - (now if self.started is None else self.started), 1e-9)
        left = duration((self.planned_runs - self.runs) / rate)
        return f"{text}: {self.settings} of {self.planned_settings} settings, {left} left"


def in_turn(
    items: Sequence[Item],
    do: Callable[[Item], Done],
    words: str,
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[Done]:
    """do(item) of each item of a job; its log says how far it is, and how long the others take.

    words: what the items are. An item whose UserError stops the job does not hide those of others,
    so that all bad scans of a job are mended at once: it is raised behind the last.
    """
    started = said = clock()
    errors = []
    for number, item in enumerate(items, start=1):
        try:
            done = do(item)
        except UserError as error:
            errors.append(error)
        else:
            yield done
        if (now := clock()) - said > SECONDS:
            left = duration((now - started) / number * (len(items) - number))
            logging.info("%d of %d %s, %s left", number, len(items), words, left)
            said = now
    if errors:
        raise errors[0] if len(errors) == 1 else UserError("\n".join(map(str, errors)))


STOPPED = "Stopped. The same command goes on where this run was; finished jobs are kept."


def failure(logs: Sequence[str]) -> str:
    """What a run that failed ends with; logs: those of the jobs that failed."""
    where = "".join(f"\n  {log}{_killed(log)}" for log in logs)
    return (
        f"{len(logs)} job(s) failed; what they said is in{where}\n"
        "Hint: mend the cause and run the same command again; finished jobs are kept."
    )


def _text(log):
    try:
        with open(log, encoding="utf-8", errors="replace") as file:
            return file.read()
    except OSError:
        return ""


def _killed(log):
    """A remark on a job that said nothing of an error: it was killed, and could not."""
    if "Error" in _text(log):
        return ""
    return (
        " (no error in it: killed from outside? If memory ran out, raise mem_mb or use -j1; "
        "or is the disk full?)"
    )


def duration(seconds: float) -> str:
    """Seconds as in '1:02:03' or '2:03'.

    >>> duration(3723)
    '1:02:03'
    """
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
