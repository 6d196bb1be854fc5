"""What a job leaves in its log, and what it says to the person who watches."""

import subprocess
import sys

import pytest
from conftest import REPOSITORY

from icpshap import config, errors, tables
from icpshap.errors import UserError

JOB = """\
import os
import sys

from icpshap.errors import DataError
from icpshap.jobs.logs import job_log

with job_log(sys.argv[1]) as terminal:
    print("said by Python")
    os.write(2, b"said by a library\\n")
    terminal.write("for the person\\n")
    {last}
"""


@pytest.fixture
def run_job(tmp_path):
    """Runs a job whose last line is given, in a process of its own: (process, text of its log)."""

    def run(last):
        log = tmp_path / "job.log"
        process = subprocess.run(
            [sys.executable, "-c", JOB.format(last=last), str(log)],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
        )
        return process, log.read_text()

    return run


def test_everything_goes_into_the_log_but_the_line_for_the_person(run_job):
    process, log = run_job("pass")
    assert process.returncode == 0
    assert process.stdout + process.stderr == "for the person\n"
    assert sorted(log.splitlines()) == ["said by Python", "said by a library"]


def test_a_mistake_of_the_users_is_a_message_without_traceback(run_job):
    process, log = run_job("raise DataError('scans/7.csv: no points.', 'export it again.')")
    assert process.returncode == 1
    assert "scans/7.csv: no points.\nHint: export it again.\n" in log
    assert "Traceback" not in log + process.stderr


@pytest.mark.parametrize(
    ("last", "error"),
    [
        ("[0, 1].index(2)", "ValueError: 2 is not in list"),
        ("open('nowhere/file')", "FileNotFoundError: "),
        ("{}['key']", "KeyError: 'key'"),
    ],
)
def test_a_mistake_of_ours_leaves_its_traceback(run_job, last, error):
    process, log = run_job(last)
    assert process.returncode == 1
    assert "Traceback (most recent call last):" in log
    assert error in log.splitlines()[-1]


@pytest.mark.parametrize(
    "error",
    [
        config.ConfigError,
        errors.DataError,
        errors.PerturbationError,
        tables.TableError,
    ],
)
def test_errors_that_the_user_can_mend(error):
    assert issubclass(error, UserError)
