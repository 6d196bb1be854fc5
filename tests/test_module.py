"""The workflow as a module of another, in another folder and with that one's configuration."""

import os
import re
import shutil
import subprocess
import sys

import pytest
import yaml
from conftest import REPOSITORY
from project import CODE, TINY, planned_jobs

from benchmarks.planned_work import local_rules

SNAKEFILE = """
configfile: "mine.yaml"


module icpshap:
    snakefile:
        {snakefile}
    config:
        config["icpshap"]


use rule * from icpshap


rule mine:
    input:
        "resources/tiny_room/scans/0.parquet",
    output:
        "mine.txt",
    shell:
        "echo {{input}} > {{output}}"
"""


@pytest.fixture
def folder(tmp_path):
    """A folder with the configuration of a workflow that has a block for the module."""
    tiny = {**yaml.safe_load(TINY.read_text()), "run": ["tiny_grid"], "sequences": ["tiny_room"]}
    # Nothing of the paper's configuration stands in it.
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"icpshap": tiny, "of_mine": 1}))
    return tmp_path


def run(folder, *arguments, **environment):
    """What snakemake says there."""
    usual = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "-j1", *arguments],
        cwd=folder,
        env={**usual, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def hosted(folder):
    """A repository as Snakemake keeps one of GitHub, below a cache folder; and its commit."""
    source, cache = folder / "source", folder / "cache"
    source.mkdir()
    for part in CODE:
        copy = shutil.copytree if (REPOSITORY / part).is_dir() else shutil.copy
        copy(REPOSITORY / part, source / part)

    def git(*arguments):
        return subprocess.run(["git", *arguments], check=True, capture_output=True, text=True)

    git("init", "-q", source)
    git("-C", source, "add", "-A")
    git("-C", source, "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "all")
    kept = cache / "snakemake/snakemake/source-cache/snakemake-git-cache/github.com/owner/name"
    git("clone", "-q", "--bare", source, kept)
    return cache, git("-C", source, "rev-parse", "HEAD").stdout.strip()


def test_of_a_clone_the_module_brings_the_library(folder):
    (folder / "Snakefile").write_text(SNAKEFILE.format(snakefile=f'"{REPOSITORY}/Snakefile"'))
    said = run(folder, "-n")
    planned = planned_jobs(said)
    assert planned["run_icp"] > 1 and planned["report"] == planned["explain_few_settings"] == 1
    # Named on the command line, a rule is that of all of its files.
    planned = planned_jobs(run(folder, "-n", "--forcerun", "explain_sequence"))
    assert planned["explain_sequence"] == 1 and "explain_few_settings" not in planned
    run(folder, "mine.txt")
    assert (folder / "mine.txt").read_text() == "resources/tiny_room/scans/0.parquet\n"


def test_under_a_prefix_local_rules_stay_local(folder):
    text = SNAKEFILE.format(snakefile=f'"{REPOSITORY}/Snakefile"')
    text = text.replace("from icpshap", "from icpshap as theirs_*")
    text += 'print("local:", *sorted(workflow._localrules))\n'
    (folder / "Snakefile").write_text(text)
    said = run(folder, "-n", "theirs_all")
    assert planned_jobs(said)["theirs_explain_few_settings"] == 1
    (local,) = re.findall(r"^local: (.*)$", said, re.M)
    assert set(local.split()) == {f"theirs_{rule}" for rule in local_rules()}


def test_of_github_where_the_library_is_installed(folder):
    cache, commit = hosted(folder)
    snakefile = f'github("owner/name", path="workflow/Snakefile", commit="{commit}")'
    (folder / "Snakefile").write_text(SNAKEFILE.format(snakefile=snakefile))
    run(folder, "mine.txt", XDG_CACHE_HOME=str(cache), PYTHONPATH=str(REPOSITORY))
    assert (folder / "mine.txt").read_text() == "resources/tiny_room/scans/0.parquet\n"
