import numpy as np
import pytest

from icpshap.diagnosis.curves import Curve
from icpshap.diagnosis.verdict import FOUND, NOTHING, UNDECIDED, UNKNOWN, Healthy, Verdict, verdict

LEVELS = np.array([0.0, 1.0, 2.0, 4.0])


def curve(*slopes, own=0):
    """A cause that changes the diagnostics by so much at its largest level."""
    return Curve(LEVELS, LEVELS[:, None] / 4 * np.array(slopes), np.zeros((4, 4)), own)


CURVES = {
    "noise": curve(2.0, 0, 0, 0.3, own=0),
    "overlap": curve(0, -2.0, 0, -0.5, own=1),
    "weak": curve(0, 0, -0.5, -2.0, own=3),
}


@pytest.fixture
def healthy():
    generator = np.random.default_rng(0)
    return Healthy.of(generator.normal(0, 0.02, (8, 4)))


def test_nothing_stands_out_of_a_usual_pair(healthy):
    found = verdict(healthy.median, healthy, CURVES)
    assert found.said[0] == NOTHING and found.nothing > 0.9
    assert set(found.levels.values()) == {0.0}


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("level", [2.0, 3.0])
def test_a_cause_is_found_at_its_level(healthy, name, level):
    change = level / 4 * CURVES[name].changes[-1]
    found = verdict(healthy.median + change, healthy, CURVES)
    word, causes, confidence = found.said
    assert (word, causes) == (FOUND, [name]) and confidence > 0.8
    assert found.levels[name] == pytest.approx(level, rel=0.1)


def test_two_causes_together_are_both_found(healthy):
    change = 0.5 * CURVES["noise"].changes[-1] + 0.75 * CURVES["overlap"].changes[-1]
    found = verdict(healthy.median + change, healthy, CURVES)
    assert set(found.said[1]) == {"noise", "overlap"}
    assert found.levels["overlap"] == pytest.approx(3.0, rel=0.1)


def test_causes_that_do_the_same_cannot_be_told_apart(healthy):
    same = {"one": curve(0, -2.0, 0, -1.0, own=1), "other": curve(0, -2.0, 0, -1.0, own=1)}
    found = verdict(healthy.median + 0.5 * same["one"].changes[-1], healthy, same)
    word, causes, confidence = found.said
    assert word == UNDECIDED and sorted(causes) == ["one", "other"] and confidence > 0.95


def test_what_no_cause_does_is_no_cause(healthy):
    better = healthy.median + np.array([-1.0, 0.3, 0.0, 0.5])
    assert verdict(better, healthy, CURVES).said[0] == NOTHING


def test_probabilities_are_those_of_all_sets(healthy):
    found = verdict(healthy.median + np.array([0.1, 0, 0, 0]), healthy, CURVES)
    assert found.nothing + max(found.probabilities.values()) <= 1 + 1e-12
    assert all(0 <= share <= 1 for share in found.probabilities.values())


def test_one_unusual_pair_does_not_change_what_is_healthy():
    logarithms = np.random.default_rng(1).normal(0, 0.02, (8, 4))
    unusual = np.vstack([logarithms, [3.0, -2.0, 1.0, -3.0]])
    assert Healthy.of(unusual).median == pytest.approx(Healthy.of(logarithms).median, abs=0.03)


def test_few_healthy_pairs_say_less():
    one, eight = (Healthy.of(np.zeros((number, 4))) for number in (1, 8))
    assert (one.deviation > eight.deviation).all()


def test_without_healthy_levels_nothing_is_known():
    nowhere = {"noise": np.nan}
    assert Verdict(nowhere, np.nan, nowhere).said[0] == UNKNOWN
