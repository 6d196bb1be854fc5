"""Profiles, and what rules say of their needs to a cluster."""

import re
from importlib.util import find_spec

import pytest
import yaml
from conftest import REPOSITORY
from project import Project

from benchmarks.planned_work import local_rules
from icpshap.jobs import few

PROFILE = REPOSITORY / "profiles" / "slurm" / "profile.yaml"
PLUGIN = re.compile(r"snakemake-executor-plugin-slurm==([\d.]+)")
RULE = re.compile(r"^rule (\w+):\n(.*?)(?=^\S|\Z)", re.M | re.S)


def rules():
    """The text of each rule by its name."""
    texts = (path.read_text() for path in sorted((REPOSITORY / "workflow/rules").glob("*.smk")))
    return dict(RULE.findall("".join(f"{text}\n" for text in texts)))


def test_every_local_rule_is_a_rule():
    assert local_rules() - {"all", *few.RULES.values()} <= set(rules())


def test_every_rule_of_few_pairs_is_that_of_many_but_for_its_sequences():
    text = (REPOSITORY / "workflow/rules/few.smk").read_text()
    made = re.findall(r"^use rule (\w+) as (\w+) with:\n    wildcard_constraints:\n", text, re.M)
    assert dict(made) == few.RULES


@pytest.mark.parametrize("name", sorted(set(rules()) - local_rules()))
def test_a_rule_that_a_cluster_runs_says_memory_and_time_and_more_at_each_attempt(name):
    asked = dict(re.findall(r"^        (mem_mb|runtime)=(.*),$", rules()[name], re.M))
    assert set(asked) == {"mem_mb", "runtime"}
    # A number would stay what it is.
    assert not any(value.isdigit() for value in asked.values())


def test_resources_grow_and_are_no_reason_to_run_again(tmp_path):
    project = Project(tmp_path)
    scans = "resources/tiny_room/scans/0.parquet"
    targets = ("--", "results/tiny_grid/tiny_room/pairs/0.parquet")
    project.tiny(*targets)
    assert "Nothing to be done" in project.tiny(
        "-n", "--set-resources", "check_pairs:runtime=7", "simulate_scans:mem_mb=77", *targets
    )
    planned = project.tiny("-n", "--forcerun", "check_pairs", *targets)
    assert "runtime=10" in planned and scans in planned


def test_the_slurm_profile_is_one():
    profile = yaml.safe_load(PROFILE.read_text())
    assert profile["executor"] == "slurm"
    assert profile["retries"] >= 1
    assert set(profile["default-resources"]) == {"slurm_partition"}
    if find_spec("snakemake_executor_plugin_slurm") is None:
        pytest.skip("snakemake-executor-plugin-slurm is not installed")
    from snakemake.cli import get_argument_parser

    known = {word for action in get_argument_parser()._actions for word in action.option_strings}
    assert {f"--{key}" for key in profile} <= known


def test_the_version_of_the_plugin_is_the_same_everywhere():
    named = {
        path: set(PLUGIN.findall((REPOSITORY / path).read_text()))
        for path in (
            "profiles/slurm/profile.yaml",
            "docs/cluster.md",
            ".github/workflows/tests.yaml",
        )
    }
    assert len(set.union(*named.values())) == 1 and all(named.values()), named
