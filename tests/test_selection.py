"""Every so many scans of a drive, so many pairs, and what is said where there are fewer."""

import pytest

from icpshap import config as configuration
from icpshap.selection import Selection

PAIRS = "experiments.same_perturbation.pairs"


def along(config, pairs, scans=30):
    """A configuration of one drive of so many scans."""
    config["data"]["street"] = {"scans": scans, "simulated": {"scene": "street", "beams": 3000}}
    config["sequences"], config["run"] = ["street"], ["same_perturbation"]
    config["experiments"]["same_perturbation"] |= {"sequences": ["street"], "pairs": pairs}
    return configuration.load(config)


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        ({}, [(i, i + 1) for i in range(6)]),
        ({"every": 3}, [(0, 1), (3, 4)]),
        ({"every": 2, "step": 3}, [(0, 3), (2, 5)]),
        ({"start": 1, "every": 2, "count": 2}, [(1, 2), (3, 4)]),
        ({"start": 5}, [(5, 6)]),
        ({"start": 6}, []),
        ({"step": 7}, []),
    ],
)
def test_pairs_of_seven_scans(selection, expected):
    assert list(Selection(**selection).pairs(7)) == expected


def test_without_keys_it_is_consecutive(config):
    selected = along(config, {}).experiments["same_perturbation"].pairs
    assert selected == along(config, "consecutive").experiments["same_perturbation"].pairs
    assert len(selected["street"]) == 29


def test_words_of_the_command_line_are_numbers(config):
    found = along(config, {"every": "10", "step": "2", "count": "1e1"})
    assert found.experiments["same_perturbation"].pairs["street"] == ((0, 2), (10, 12), (20, 22))


def test_fewer_pairs_than_asked_for_are_said(config):
    (line,) = along(config, {"every": 10, "count": 200}).remarks
    assert line.startswith("same_perturbation: 3 pairs of street, not count: 200: ")
    assert along(config, {"every": 10, "count": 3}).remarks == ()
    assert along(config, {"every": 10}).remarks == ()


def test_a_sequence_without_a_pair_is_said_and_left_out(config):
    found = along(config, {"start": 29})
    assert found.experiments["same_perturbation"].pairs == {}
    (line,) = found.remarks
    assert line == (
        "same_perturbation: no pair of street: the first would be scans 29 and 30, and "
        "data.street.scans is 30."
    )


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ({"evry": 2}, f"{PAIRS}: unknown key 'evry', did you mean 'every'?"),
        ({"every": 0}, f"{PAIRS}.every: 0 is less than the minimum of 1 (From the reference"),
        ({"step": 1.5}, f"{PAIRS}.step: 1.5 is not of type 'integer'"),
        ({"count": "many"}, f"{PAIRS}.count: 'many' is not of type 'integer'"),
    ],
)
def test_what_is_wrong_with_it(config, pairs, message):
    with pytest.raises(configuration.ConfigError) as error:
        along(config, pairs)
    assert message in str(error.value)


def test_it_needs_sequences(config):
    config["experiments"]["same_perturbation"]["pairs"] = {"every": 2}
    del config["experiments"]["same_perturbation"]["sequences"]
    with pytest.raises(configuration.ConfigError, match="needs it"):
        configuration.load(config)


def test_a_scene_is_one_of_the_selected_pairs(config):
    scene = {"sequence": "street", "reference": 10, "source": 12}
    config["experiments"]["same_perturbation"]["scenes"] = [scene]
    along(config, {"every": 10, "step": 2})
    with pytest.raises(configuration.ConfigError, match="street 10, 12 is not one of"):
        along(config, {"every": 10})
