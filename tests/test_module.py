"""The workflow as a module of another, in another folder and with that one's configuration."""

import os
import re
import subprocess
import sys

import yaml
from conftest import REPOSITORY
from project import TINY

SNAKEFILE = f"""
configfile: "mine.yaml"


module icpshap:
    snakefile:
        "{REPOSITORY}/Snakefile"
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


def run(folder, *arguments):
    """What snakemake says there; the library is found by nothing but the module."""
    done = subprocess.run(
        [sys.executable, "-m", "snakemake", "-j1", *arguments],
        cwd=folder,
        env={key: value for key, value in os.environ.items() if key != "PYTHONPATH"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def test_another_workflow_uses_this_one(tmp_path):
    (tmp_path / "Snakefile").write_text(SNAKEFILE)
    # Nothing of the paper's configuration that it is laid over stands here.
    tiny = {**yaml.safe_load(TINY.read_text()), "run": ["tiny_grid"], "sequences": ["tiny_room"]}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump({"icpshap": tiny, "of_mine": 1}))
    said = run(tmp_path, "-n")
    planned = {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", said, re.M)}
    assert planned["run_icp"] > 1 and planned["report"] == planned["explain_sequence"] == 1
    run(tmp_path, "mine.txt")
    assert (tmp_path / "mine.txt").read_text() == "resources/tiny_room/scans/0.parquet\n"
