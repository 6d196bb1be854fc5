"""Which jobs surely take seconds, by the configuration alone."""

import copy

import pytest
import yaml
from conftest import REPOSITORY
from snakemake.utils import update_config

from icpshap import config as configuration
from icpshap.jobs import few
from icpshap.jobs.plans import Plans

PAPER_CONFIG = yaml.safe_load((REPOSITORY / "config.yaml").read_text(encoding="utf-8"))
ROOM = {"scans": 101, "simulated": {"scene": "apartment", "beams": 100_000}}


def planner(pairs, data=ROOM, **estimator):
    """One of an experiment `own` of a sequence `own`."""
    changes = {
        "data": {"own": data},
        "estimators": {"own": {"based_on": "paper", **estimator}},
        "experiments": {
            "own": {
                "estimator": "own",
                "pairs": {"count": pairs},
                "sequences": ["own"],
                "instances": {"fixed": {"sensor_noise": 0.05, "initial_pose": 1.5}},
                "figures": [],
            }
        },
    }
    config = copy.deepcopy(PAPER_CONFIG)
    update_config(config, changes)
    return Plans(configuration.load(config), {}, lambda *_: "")


def short(*arguments, **keywords):
    """The rules of `own`, of which its jobs are short."""
    found = few.few(planner(*arguments, **keywords))
    return {rule for rule, sequences in found.items() if "own/own" in sequences}


def test_of_a_pair_all_are():
    assert short(1) == set(few.RULES)


def test_of_more_pairs_the_diagnosis_is_the_first_that_is_not():
    """100,000 points: 3 s a pair, against 1.5 s of a check and 0.1 s of an explanation."""
    assert short(6) == set(few.RULES)
    assert short(7) == set(few.RULES) - {"diagnose_pairs"}
    assert short(14) == {"explain_sequence"}


def test_an_explanation_of_many_runs_or_by_the_bootstrap_takes_longer():
    pairs, settings = 100, 6
    assert "explain_sequence" in short(pairs)
    assert "explain_sequence" not in short(pairs, runs=400)
    assert "explain_sequence" not in short(pairs, interval="bootstrap")
    found = few.seconds(planner(pairs), "own", "own")["explain_sequence"]
    assert found == pytest.approx(pairs * settings * (0.01 + 0.2 * 0.1**2), rel=0.2)


def test_of_files_on_disk_only_what_does_not_hang_on_their_points(tmp_path):
    """Which no configuration says: one scan may have as many as hundreds of others."""
    own = {"scans": 3, "folder": {"path": str(tmp_path)}}
    assert short(1, own) == {"explain_sequence"}


def test_of_an_archive_its_scanner_says_how_many_there_may_be():
    assert short(1, {"scans": 3, "archive": {"url": "https://x"}}) == set(few.RULES)


def test_an_experiment_without_a_pair_in_a_sequence_has_no_job_there():
    found = few.few(planner(1))
    assert all("/" in name for names in found.values() for name in names)
    assert not any("own/apartment" in names for names in found.values())
