"""The mitigation benchmark counts as it says."""

import json

import numpy as np
import pytest

from benchmarks import mitigation
from benchmarks.mitigation import Counts, Drops, Error, holds, log_ratio

GROUP = ("simulated", "all")


def drops(values, half):
    """Drops whose differences are known to plus or minus `half`."""
    values = np.array(values)
    apart = values[:, None] - values
    return Drops(values, np.array([apart, apart - half, apart + half]))


@pytest.mark.parametrize(
    ("named", "right", "regret"), [(0, 1.0, 0.0), (1, 0.0, 0.5), (2, 0.0, 1.2)]
)
def test_a_clear_best_removal_is_right_alone(named, right, regret):
    counts = Counts()
    counts.count_removal("f", named, drops([2.0, 1.0, -0.4], half=0.9), [GROUP])
    assert counts.clear["f"].share(GROUP)[0] == right and not counts.unclear["f"].number
    assert counts.regret["f"][GROUP] == pytest.approx([regret])


@pytest.mark.parametrize(("named", "right"), [(0, 1.0), (1, 1.0), (2, 0.0)])
def test_of_two_that_cannot_be_told_apart_either_is_right(named, right):
    counts = Counts()
    counts.count_removal("f", named, drops([2.0, 1.5, 0.2], half=0.9), [GROUP])
    assert counts.unclear["f"].share(GROUP)[0] == right and not counts.clear["f"].number


def test_without_a_positive_drop_there_is_no_regret():
    assert np.isnan(drops([-0.1, -0.2], half=0.01).regret(1))


def test_differences_of_drops_are_those_of_the_games():
    game = np.array([0.0, 1.0, 4.0, 5.0])  # clean, without the first, without the second, all
    found = mitigation._differences(game)
    np.testing.assert_array_equal(found, [4.0, 1.0, 0.0, 3.0, -3.0, 0.0])


def test_half_the_error_in_every_draw_is_known_exactly():
    generator = np.random.default_rng(1)
    square = generator.chisquare(6, 40)
    draws = np.repeat(np.arange(4), 10)
    now, changed = (Error(factor * square, draws, None) for factor in (1.0, 0.25))
    assert log_ratio(changed, now) == pytest.approx([np.log(0.5)] * 3)
    square[0] = np.nan  # a run that failed in one of them counts in neither
    assert log_ratio(changed, Error(square, draws, None)) == pytest.approx([np.log(0.5)] * 3)


def test_an_interval_is_widened_in_squares_by_that_of_the_fresh_value():
    stated = np.array([10.0, 7.0, 13.0])
    assert holds(stated, np.array([14.9, 10.9, 18.9]))  # 3 and 4 make 5
    assert not holds(stated, np.array([15.1, 11.1, 19.1]))
    assert not holds(stated, np.array([4.9, 0.9, 8.9]))


def test_a_promise_is_kept_where_the_error_falls():
    counts = Counts()
    counts.count_promise(np.log(0.5), np.log(0.7), [GROUP])
    counts.count_promise(np.log(0.5), np.log(1.1), [GROUP])
    assert counts.promised.share(GROUP)[0] == 0.5
    assert counts.kept[GROUP] == pytest.approx([0.515, -0.138], abs=1e-3)


def test_what_was_not_run_is_null():
    values = mitigation._json(Counts())
    assert values == {"removal_is_best": None, "regret": None, "advice_right": None}
    json.dumps(values, allow_nan=False)
