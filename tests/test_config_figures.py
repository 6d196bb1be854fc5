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
