"""What a run says while it runs and when it ends, and what it was made with."""

import io
import logging
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from conftest import REPOSITORY

from icpshap.errors import DataError, UserError
from icpshap.jobs import parents, progress
from icpshap.jobs import provenance as record

# --- provenance -----------------------------------------------------------------------------------


def test_provenance_survives_yaml_and_names_licences(tmp_path):
    config = {"run": ["an_experiment"], "seed": 1}
    sequences = {"apartment": "archive", "room": "simulated"}
    made_with = record.provenance(config, sequences, tmp_path, tmp_path)
    assert yaml.safe_load(yaml.safe_dump(made_with)) == made_with
    assert "CC BY 4.0" in made_with["data"]["apartment"]
    assert made_with["data"]["room"] == "made by icpshap, MIT"
    assert made_with["packages"]["numpy"] == np.__version__
    assert made_with["commit"] == ""
    assert made_with["host"]["cores"] >= 1


def test_commit_says_when_files_differ(tmp_path):
    def git(*arguments):
        subprocess.run(["git", "-C", tmp_path, *arguments], check=True, capture_output=True)

    git("init")
    (tmp_path / "file").write_text("one")
    git("add", "file")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-m", "first")
    assert re.fullmatch(r"[0-9a-f]{40}", record.commit(tmp_path))
    (tmp_path / "file").write_text("two")
    assert re.fullmatch(r"[0-9a-f]{40}-dirty", record.commit(tmp_path))


def test_job_times_count_the_selected_only(tmp_path):
    for path, seconds in {
        "run_icp/chosen/room/0-1/0.tsv": 2.5,
        "run_icp/chosen/room/0-1/1.tsv": 4.0,
        "run_icp/other/room/0-1/0.tsv": 99.0,
        "draw_figure/other/summary.tsv": 1.0,
    }.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(f"s\th:m:s\n{seconds}\t0:00:00\n")
    times = record.job_times(tmp_path, {"chosen"})
    assert times.to_numpy().tolist() == [["run_icp", 2, 6.5, 4.0]]


@pytest.mark.parametrize("text", ["", "s\n", "h:m:s\n0:00:01\n", "s\ninf\n", "\x00\x01"])
def test_broken_benchmark_files_are_passed_over(tmp_path, text):
    """A kill or a full disk leaves them; the report does not fail on them."""
    folder = tmp_path / "run_icp" / "chosen"
    folder.mkdir(parents=True)
    (folder / "0.tsv").write_text("s\th:m:s\n2.5\t0:00:02\n")
    (folder / "1.tsv").write_text(text)
    assert record.job_times(tmp_path, {"chosen"}).to_numpy().tolist() == [["run_icp", 1, 2.5, 2.5]]


# --- what a run says ------------------------------------------------------------------------------


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def watched():
    """A logger whose jobs `progress` reports, and what reaches the terminal by both ways."""
    terminal, own, clock = io.StringIO(), io.StringIO(), Clock()
    logger = logging.Logger("snakemake")
    logger.addHandler(logging.StreamHandler(own))
    lines = progress.Progress(
        terminal, lambda: (20, 2000), lambda wildcards: (5, 500), ("run_icp",), clock
    )
    dry = SimpleNamespace(run=False)
    stopped = SimpleNamespace(run=False)
    progress.replace_job_lines(logger, lines, lambda: dry.run, lambda: stopped.run)
    return SimpleNamespace(
        logger=logger,
        lines=lines,
        terminal=terminal,
        own=own,
        clock=clock,
        dry=dry,
        stopped=stopped,
    )


def run_job(logger, number, rule, **wildcards):
    info = {"event": "job_info", "jobid": number, "rule_name": rule, "wildcards": wildcards}
    logger.info("starts", extra=info)
    logger.info("ends", extra={"event": "job_finished", "job_id": number})


def test_a_line_per_job_with_settings_done_and_time_left(watched):
    watched.logger.info("Job stats", extra={"event": "run_info", "stats": {"total": 12}})
    run_job(watched.logger, 3, "read_scans", sequence="room", batch="0")
    info = {"event": "job_info", "jobid": 4, "rule_name": "run_icp", "wildcards": {"chunk": "0"}}
    watched.logger.info("starts", extra=info)
    watched.clock.now = 2.0
    watched.logger.info("ends", extra={"event": "job_finished", "job_id": 4})
    assert watched.terminal.getvalue().splitlines() == [
        "[ 1/12] read_scans room 0",
        "[ 2/12] run_icp 0: 5 of 20 settings, 0:06 left",
    ]
    assert watched.own.getvalue() == "Job stats\n"


def test_errors_and_other_messages_still_reach_the_terminal(watched):
    failed = {"event": "job_error", "log": ["logs/run_icp/room/0-1/0.log"]}
    watched.logger.error("a job failed", extra=failed)
    watched.logger.info("Nothing to be done")
    watched.logger.info("Select jobs to execute...")
    assert watched.own.getvalue() == "a job failed\nNothing to be done\n"
    said = progress.failure(watched.lines.failed)
    assert said.startswith("1 job(s) failed; what they said is in\n  logs/run_icp/room/0-1/0.log")
    assert "Hint: mend the cause and run the same command again" in said


@pytest.mark.parametrize(
    ("log", "says"),
    [
        ("", "killed from outside? If memory ran out, raise mem_mb"),
        ("Compiling the ICP engine\n", "killed from outside?"),
        ("DataError: s1.csv: no points.\n", None),
        ("Traceback ...\nKeyError: 3\n", None),
    ],
)
def test_a_job_that_said_nothing_was_killed(tmp_path, log, says):
    path = tmp_path / "0.log"
    path.write_text(log)
    said = progress.failure([str(path)])
    assert (says in said) if says else "killed" not in said


def test_of_a_run_that_was_stopped_only_that_is_said(watched):
    """Its jobs failed since they were stopped; nobody has to mend anything."""
    watched.stopped.run = True
    watched.logger.error("Error in rule run_icp", extra={"event": "job_error", "log": []})
    watched.logger.error(progress.STOPPED)
    assert watched.own.getvalue() == f"{progress.STOPPED}\n"


def test_a_dry_run_keeps_snakemakes_own_lines(watched):
    watched.dry.run = True
    watched.logger.info("Job stats", extra={"event": "run_info", "stats": {"total": 1}})
    run_job(watched.logger, 3, "read_scans", sequence="room")
    assert watched.terminal.getvalue() == ""
    assert watched.own.getvalue() == "Job stats\nstarts\nends\n"


@pytest.mark.parametrize("seconds, text", [(0.2, "0:00"), (65, "1:05"), (3661.4, "1:01:01")])
def test_durations(seconds, text):
    assert progress.duration(seconds) == text


class TestInTurn:
    """A job of many items says how far it is, and names all that are bad."""

    def test_what_fails_hides_nothing_of_the_others(self):
        def do(item):
            if item % 2:
                raise UserError(f"item {item} is bad")
            return -item

        found = []
        with pytest.raises(UserError, match=r"^item 1 is bad\nitem 3 is bad$"):
            found.extend(progress.in_turn([0, 1, 2, 3, 4], do, "scans"))
        assert found == [0, -2, -4]

    def test_one_error_stays_what_it_is(self):
        def do(item):
            raise DataError("a.csv: no points", "get it again")

        with pytest.raises(DataError, match=r"^a.csv: no points\nHint: get it again$"):
            list(progress.in_turn([0], do, "scans"))

    def test_the_log_says_how_far_it_is_now_and_then(self, caplog):
        caplog.set_level(logging.INFO)
        times = iter(range(0, 100, 4))
        list(progress.in_turn(range(6), abs, "pairs", clock=lambda: next(times)))
        assert caplog.messages == ["3 of 6 pairs, 0:12 left", "6 of 6 pairs, 0:00 left"]


class TestCtrlC:
    @pytest.fixture(autouse=True)
    def folder(self, tmp_path, monkeypatch):
        (tmp_path / ".snakemake").mkdir()
        monkeypatch.chdir(tmp_path)
        monkeypatch.delenv(parents.PARENT, raising=False)
        monkeypatch.setenv(parents.PARENT, "")  # so that what be_parent sets is undone
        parents.be_parent()

    def test_before_the_first_job_it_ends_in_words(self):
        with pytest.raises(SystemExit, match="how to go on"):
            parents.CtrlC("how to go on")(2, None)

    def test_jobs_end_and_snakemake_hears_of_it(self, tmp_path):
        code = "import time; from icpshap.jobs import parents; parents.end_with_parent(); "
        job = subprocess.Popen(
            [sys.executable, "-c", code + "time.sleep(60)"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(REPOSITORY)},
        )
        handler = parents.CtrlC("")
        handler.has_jobs = True
        with pytest.raises(KeyboardInterrupt):
            handler(2, None)
        assert handler.pressed
        assert job.wait(timeout=30) == 1

    def test_at_the_very_end_there_is_nothing_to_stop(self):
        """Python waits for threads then, and whoever presses once more sees no traceback."""
        code = """if True:
            import signal, threading, time
            from icpshap.jobs import parents
            handler = parents.CtrlC("")
            handler.has_jobs = True
            signal.signal(signal.SIGINT, handler)
            def press():
                time.sleep(0.3)
                signal.raise_signal(signal.SIGINT)
                time.sleep(0.3)
            threading.Thread(target=press).start()
            """
        environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True
        )
        assert (done.returncode, done.stderr) == (0, "")

    def test_a_new_run_begins_unstopped(self, tmp_path):
        marker = tmp_path / parents.STOPPED.format(os.getpid())
        marker.touch()
        parents.be_parent()
        assert not marker.exists()

    def test_a_shell_that_starts_a_job_is_deaf_to_it(self):
        command = f"{parents.DEAF} kill -INT $$; echo alive"
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
        assert done.stdout == "alive\n"
