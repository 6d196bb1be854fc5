"""The workflow through Slurm: see benchmarks/slurm."""

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest
from conftest import REPOSITORY

from benchmarks.planned_work import Task
from benchmarks.slurm import cluster, workplace
from benchmarks.slurm.simulation import Measured, simulated
from icpshap.errors import UserError

SECONDS = 3600


@pytest.mark.job
def test_slurm_makes_the_same_bytes_and_every_case_is_got_over():
    if reason := cluster.missing():
        pytest.skip(reason)
    if find_spec("snakemake_executor_plugin_slurm") is None:
        pytest.skip("snakemake-executor-plugin-slurm is not installed")
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.slurm"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["bytes_equal"] and found["cases_equal"] == found["cases"] > 0


def test_a_configuration_of_slurm_that_is_not_ours_is_left_alone(tmp_path, monkeypatch):
    theirs = tmp_path / "slurm.conf"
    theirs.write_text("ClusterName=theirs\n")
    monkeypatch.setattr(cluster, "CONFIGURATION", theirs)
    monkeypatch.setattr(cluster, "missing", lambda: "")
    with pytest.raises(UserError, match=f"{theirs}: .* not ours"), cluster.Cluster():
        pass
    assert theirs.read_text() == "ClusterName=theirs\n"


def test_what_squeue_says_is_read(monkeypatch):
    said = (
        "7|RUNNING|2026-01-02T03:04:05|2026-01-02T03:04:15|N/A|20:00|rule_run_icp_wildcards_a_b_0\n"
        "8|PENDING|2026-01-02T03:04:05|N/A|N/A|1-01:10:00|rule_explain_sequence_wildcards_a_b"
    )
    monkeypatch.setattr(workplace, "asked", lambda *_: said)
    running, waiting = workplace.slurm_jobs()
    assert (running.number, running.state, running.rule) == ("7", "RUNNING", "run_icp")
    assert running.started - running.submitted == 10 and running.ended is None
    assert (waiting.rule, waiting.started) == ("explain_sequence", None)
    assert [job.minutes for job in (running, waiting)] == [20, 25 * 60 + 10]


class TestListScheduling:
    EXACT = Measured(overheads=[0.0], spreads=[1.0], notice=0.0)

    def test_jobs_share_the_cores(self):
        tasks = [Task("run_icp", 3600.0, ())] * 4
        assert simulated(tasks, 2, self.EXACT).hours == pytest.approx(2)
        assert simulated(tasks, 4, self.EXACT).hours == pytest.approx(1)

    def test_more_cores_than_jobs_help_nothing(self):
        tasks = [Task("run_icp", 3600.0, ())] * 4
        assert simulated(tasks, 500, self.EXACT) == simulated(tasks, 4, self.EXACT)

    def test_a_job_waits_for_others(self):
        tasks = [Task("a", 3600.0, ()), Task("b", 1800.0, ()), Task("c", 3600.0, (0, 1))]
        assert simulated(tasks, 2, self.EXACT).hours == pytest.approx(2)

    def test_overhead_is_a_share_of_what_cores_are_occupied_for(self):
        tasks = [Task("run_icp", 3600.0, ())] * 4
        found = simulated(tasks, 1, Measured([1200.0], [1.0], 0.0))
        assert found.share == pytest.approx(1 / 4)
        assert found.hours == pytest.approx(4 * (1 + 1 / 3))

    def test_an_end_is_noticed_later(self):
        tasks = [Task("a", 60.0, ()), Task("b", 60.0, (0,))]
        hours = simulated(tasks, 1, Measured([0.0], [1.0], 3600.0)).hours
        assert 120 / 3600 < hours < 2 + 120 / 3600
