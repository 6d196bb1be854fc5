"""How many jobs there are, and which of them a cluster runs: docs/scale.md."""

from collections import Counter

import pytest
from project import Project, planned_jobs

from benchmarks import planned_work, scale
from icpshap.jobs import few


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """The jobs of the paper by rule, once its scans are fetched, as Snakemake plans them."""
    jobs = planned_jobs(Project(tmp_path_factory.mktemp("paper")).run("-n"))
    return {rule: jobs[rule] for rule in jobs if rule not in {*scale.FETCHING, "total"}}


def test_jobs_of_the_paper_are_few_and_the_short_ones_stay_here(paper):
    assert sum(paper.values()) <= 150
    local, not_local = planned_work.short_jobs(paper, planned_work.paper())
    assert not_local == 0 and local <= 60
    # Not because all that a cluster is for stays here.
    assert sum(paper[rule] for rule in paper if rule not in planned_work.local_rules()) > 40


def test_the_jobs_whose_seconds_are_known_are_those_that_are_planned(paper):
    known = Counter(task.rule for task in planned_work.paper())
    assert known == {rule: paper[rule] for rule in known}
    assert set(paper) - set(known) <= planned_work.local_rules()


def test_a_short_job_of_another_rule_is_counted_as_one_for_a_cluster():
    tasks = [
        planned_work.Task("run_icp", 5.0, ()),
        planned_work.Task("run_icp", 50.0, ()),
        planned_work.Task("explain_few_settings", 5.0, ()),
    ]
    jobs = {"run_icp": 2, "explain_few_settings": 1, "report": 1, "unknown": 3}
    assert planned_work.short_jobs(jobs, tasks) == (2, 4)


def test_tasks_of_local_rules_are_not_submitted_and_not_waited_for():
    tasks = [
        planned_work.Task("check_few_pairs", 5.0, ()),
        planned_work.Task("check_pairs", 50.0, ()),
        planned_work.Task("run_icp", 50.0, (0, 1)),
    ]
    found = planned_work.submitted(tasks)
    assert found == [tasks[1], tasks[2]._replace(after=(0,))]


def test_every_rule_of_few_is_local():
    assert set(few.RULES.values()) <= planned_work.local_rules()
