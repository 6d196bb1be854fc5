"""A configuration cannot ask for a picture of something that the experiment does not have."""

import re

import pytest

from icpshap import config as configuration


def test_a_scene_must_be_one_of_the_pairs(config):
    block = config["experiments"]["different_perturbations"]
    block["scenes"] = [{"sequence": "apartment", "reference": 3, "source": 4}]
    message = (
        "experiments.different_perturbations.scenes: apartment 3, 4 is not one of the "
        "experiment's pairs. Hint: list it under pairs too"
    )
    with pytest.raises(configuration.ConfigError, match=re.escape(message)):
        configuration.load(config)
    block["pairs"] += block["scenes"]
    block["figures"] = ["summary"]
    configuration.load(config)


def test_a_waterfall_of_several_pairs_is_an_error_of_the_configuration(config):
    config["experiments"]["same_perturbation"]["figures"] += ["waterfall"]
    with pytest.raises(configuration.ConfigError, match="waterfall shows one pair, and the exper"):
        configuration.load(config)


def test_a_drive_of_a_grid_needs_the_instance_that_it_shows(config):
    block = config["experiments"]["different_perturbations"]
    block["figures"] = ["drive"]
    assert "drive" in configuration.load(config).experiments["different_perturbations"].figures
    del block["waterfall"]
    with pytest.raises(configuration.ConfigError, match="asks for the drive of an instance"):
        configuration.load(config)


def test_a_drive_of_diagnosed_instances_is_an_error(config):
    block = config["experiments"]["same_perturbation"]
    block |= {"instances": "here", "figures": ["drive"]}
    with pytest.raises(configuration.ConfigError, match="drive shows one instance, and each pair"):
        configuration.load(config)


def test_a_sequence_of_few_pairs_has_no_drive_and_that_is_said(config):
    block = config["experiments"]["same_perturbation"]
    config["sequences"] = ["stairs"]
    for count, said in ((1, "1 pair"), (4, "4 pairs")):
        block |= {"figures": ["drive"], "pairs": {"count": count}}
        (line,) = configuration.load(config).remarks
        assert line == (
            f"same_perturbation: no figure drive of stairs: it has {said}, expected at least 5."
        )
    block["pairs"] = {"count": 5}
    assert configuration.load(config).remarks == ()
