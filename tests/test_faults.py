"""The short campaign of faults: each ends in the right result or in an error that names its cause.

The full one is `python -m benchmarks.faults`; see docs/faults.md.
"""

import json
import subprocess
import sys

import pytest
from conftest import REPOSITORY

from benchmarks.faults import outcome
from benchmarks.faults.outcome import Outcome, Tried
from icpshap.errors import DataError

SECONDS = 1500  # three minutes of work, on a machine that does something else besides


@pytest.mark.job
def test_no_fault_of_the_short_campaign_is_wrong_and_none_crashes_or_hangs():
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.faults", "--short"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert done.stdout, done.stderr
    counts = json.loads(done.stdout.splitlines()[-1])
    assert counts["faults"] >= 100
    assert (counts["wrong"], counts["crash"], counts["hang"]) == (0, 0, 0), done.stdout
    assert done.returncode == 0


class TestHowOutcomesAreJudged:
    """A campaign that calls everything right would be worth nothing."""

    @pytest.mark.parametrize(
        ("call", "kind"),
        [
            (lambda: 1, "right"),
            (lambda: 2, "wrong"),
            (lambda: [][0], "crash"),
            (lambda: _refuse("scans/s1.csv: no points"), "told"),
            (lambda: _refuse("no points"), "crash"),
        ],
    )
    def test_of_a_call(self, call, kind):
        assert outcome.of_call(call, lambda found: found == 1, "s1.csv").kind == kind

    def test_a_traceback_is_a_crash_whatever_it_names(self):
        said = "Traceback (most recent call last):\n  ...\nOSError: s1.csv"
        assert outcome.said_of(said, "s1.csv").kind == "crash"

    def test_the_table_and_the_counts(self):
        tried = [
            Tried("a", "first", Outcome("right")),
            Tried("a", "second", Outcome("told")),
            Tried("b", "third", Outcome("hang")),
        ]
        lines = outcome.table(tried).splitlines()
        assert lines[2:] == [
            "| a | 2 | 1 | 1 | 0 | 0 | 0 |",
            "| b | 1 | 0 | 0 | 0 | 0 | 1 |",
            "| all | 3 | 1 | 1 | 0 | 0 | 1 |",
        ]
        counts = {"faults": 3, "wrong": 0, "crash": 0, "hang": 1}
        assert json.loads(outcome.summary(tried)) == counts


def _refuse(problem):
    raise DataError(problem, "mend it")
