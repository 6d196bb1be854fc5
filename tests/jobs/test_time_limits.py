"""What a cluster is told of how long a job may take."""

import pytest

from icpshap.estimators import KINDS, Estimator
from icpshap.jobs import time_limits


def test_a_short_job_has_the_fewest_minutes():
    assert time_limits.minutes(0) == time_limits.minutes(1) == time_limits.FEWEST


def test_a_long_job_has_several_times_what_it_takes():
    assert time_limits.minutes(3600) == 60 * time_limits.MARGIN


@pytest.mark.parametrize("seconds", [0, 3600])
def test_each_attempt_has_as_much_more(seconds):
    first = time_limits.minutes(seconds)
    assert [time_limits.minutes(seconds, attempt) for attempt in (1, 2, 3)] == [
        first,
        2 * first,
        3 * first,
    ]


def test_every_kind_that_is_timed_is_one():
    assert set(time_limits.OF_RUN) <= set(KINDS)


def seconds(kind, options=None, number=8, points=367_000):
    return time_limits.seconds_of_settings(Estimator.of(kind, options or {}), number, points)


def test_a_pair_of_the_paper_takes_what_was_measured():
    """The 8 settings of 100 runs of Apartment: 41.9 s (docs/engine.md)."""
    assert seconds("monte_carlo", {"runs": 100}) == pytest.approx(41.9, rel=0.05)


@pytest.mark.parametrize(
    ("kind", "options", "of_setting"),
    [
        ("closed_form", {"subsampling_probability": 1}, 0.8),
        ("unscented", {"subsampling_probability": 0.03}, 1.6),
        ("gicp", {"subsampling_probability": 1}, 3.6),
        ("stein", {"subsampling_probability": 1}, 1.1),
        ("bayesian", {"subsampling_probability": 1}, 1.1),
        ("stein_newton", {"subsampling_probability": 0.1}, 12),
    ],
)
def test_no_kind_is_given_less_than_it_was_measured_to_take(kind, options, of_setting):
    """Seconds of a setting of 367,000 points: docs/estimators.md, speed."""
    given = time_limits.MARGIN * seconds(kind, options, number=1)
    assert 2 * of_setting < given < 12 * of_setting


def test_more_points_runs_and_settings_take_longer():
    once = seconds("monte_carlo")
    assert seconds("monte_carlo", points=2 * 367_000) == pytest.approx(2 * once)
    assert seconds("monte_carlo", number=16) == pytest.approx(2 * once)
    assert seconds("monte_carlo", {"runs": 200}) > 1.5 * once


def test_a_registration_of_ones_own_may_be_slow():
    own = {"register": "icpshap.registrations:small_gicp", "subsampling_probability": 0.05}
    assert seconds("callable", own) > 5 * seconds("monte_carlo")


@pytest.mark.parametrize(
    ("settings", "runs", "interval", "measured"),
    [
        (9, 100, "jackknife", 0.085),
        (1332, 100, "jackknife", 1.9),
        (9, 1000, "jackknife", 1.8),
        (432, 1000, "jackknife", 57),
        (9, 100, "bootstrap", 0.6),
    ],
)
def test_no_explanation_is_given_less_than_it_was_measured_to_take(
    settings, runs, interval, measured
):
    """CPU seconds of `games.explain` and `games.resampled_values`."""
    given = time_limits.seconds_of_explanation(settings, runs, interval)
    assert measured < 1.02 * given < 12 * measured


def test_a_pair_alone_is_diagnosed_by_its_numbers_alone():
    """367,000 points: 0.7 s of its numbers, and 10.5 s of what each cause would do to it."""
    assert 0.7 < time_limits.seconds_of_diagnosis(1, 367_000) < 1
    assert 10.5 + 0.7 < 1.05 * time_limits.seconds_of_diagnosis(3, 367_000) / 3 < 15
