"""Which settings are run, and how they are cut into jobs."""

from itertools import accumulate, pairwise

import pytest

from icpshap import plan
from icpshap.causes import CAUSES
from icpshap.plan import Setting

LEVELS = {
    "sensor_noise": (0.02, 0.05),
    "initial_pose": (1.0, 1.5),
    "partial_overlap": (0.0, 0.05, 0.1),
}
OFF = {name: CAUSES[name].off for name in LEVELS}
PAIRS = [(0, 1), (1, 2), (2, 3)]
SETTINGS = plan.settings(LEVELS, 1)


def test_settings_are_the_levels_and_the_reference_values_each_once():
    found = [s.levels for s in SETTINGS if not s.again]
    assert len(found) == len(set(found)) == 3 * 2 * 3
    assert {s.values["sensor_noise"] for s in SETTINGS} == {0.0, 0.02, 0.05}


def test_every_coalition_of_every_instance_is_a_setting():
    found = {s.levels for s in SETTINGS}
    for instance in plan.instances(LEVELS):
        for mask in range(8):
            on = {
                name: instance[name] if mask >> k & 1 else OFF[name] for k, name in enumerate(OFF)
            }
            assert Setting.at(on).levels in found


def test_one_second_clean_sample_for_each_replicate():
    again = [s for s in plan.settings(LEVELS, 3) if s.again]
    assert [(s.values, s.replicate) for s in again] == [(OFF, k) for k in range(3)]


def test_settings_name_the_causes_of_the_experiment_and_no_others():
    assert [s.values for s in plan.settings({"sensor_noise": (0.05,)}, 1)] == [
        {"sensor_noise": 0.0},
        {"sensor_noise": 0.0},
        {"sensor_noise": 0.05},
    ]
    setting = Setting.at({"sensor_noise": 0.05})
    assert setting.level(CAUSES["sensor_noise"]) == 0.05
    assert setting.level(CAUSES["initial_pose"]) == 1.0


def test_the_order_in_which_causes_are_named_does_not_matter():
    backwards = dict(reversed(LEVELS.items()))
    assert plan.settings(backwards, 2) == plan.settings(LEVELS, 2)
    assert plan.instances(backwards) == plan.instances(LEVELS)


def all_settings(jobs, pair):
    parts = [part for job in jobs for part in job if part.pair == pair]
    return [k for part in parts for k in range(part.start, part.stop)]


@pytest.mark.parametrize("runs_per_job", [1, 100, 250, 700, 4000, 100_000])
def test_jobs_hold_every_setting_of_every_pair_once_and_stay_small(runs_per_job):
    jobs = plan.jobs(PAIRS, LEVELS, 2, runs=100, runs_per_job=runs_per_job)
    for pair in PAIRS:
        assert all_settings(jobs, pair) == list(range(len(plan.settings(LEVELS, 2))))
    *sizes, last = [sum(part.stop - part.start for part in job) for job in jobs]
    most = max(1, runs_per_job // 100)
    assert all(0 < size <= most for size in sizes) and 0 < last < 1.25 * most + 1


@pytest.mark.parametrize(
    ("pairs", "expected"), [(14, [10, 4]), (12, [12]), (22, [10, 12]), (2, [2])]
)
def test_what_is_too_little_for_a_job_is_in_the_one_before(pairs, expected):
    """Pairs of 9 settings, 10 to a job of at most 9,000 runs."""
    fixed = {name: values[-1:] for name, values in LEVELS.items()}
    jobs = plan.jobs([(k, k + 1) for k in range(pairs)], fixed, 1, 100, 9000)
    assert [len(job) for job in jobs] == expected
    assert plan.batches(range(pairs), 10) == [range(*ends) for ends in _ends(expected)]


def _ends(sizes):
    stops = list(accumulate(sizes))
    return pairwise([0, *stops])


def test_what_is_left_of_a_pair_is_in_the_job_before_as_one_part():
    levels = {"sensor_noise": (0.01, 0.02, 0.03, 0.04, 0.05), "initial_pose": (1.5,)}
    assert plan.jobs([(0, 1)], levels, 1, 100, 1100) == [[plan.Part((0, 1), 0, 13)]]


@pytest.mark.parametrize("items", range(1, 40))
def test_an_item_added_at_the_end_changes_no_batch_but_the_last(items):
    before, after = (plan.batches(range(number), 10) for number in (items, items + 1))
    assert after[: len(before) - 1] == before[:-1]
    assert [k for batch in before for k in batch] == list(range(items))


def test_reference_levels_stay_whole_where_they_fit():
    for job in plan.jobs(PAIRS, LEVELS, 1, runs=100, runs_per_job=800):
        for part in job:
            settings = SETTINGS[part.start : part.stop]
            for level in {s.values["sensor_noise"] for s in settings}:
                of_level = [s for s in SETTINGS if s.values["sensor_noise"] == level]
                assert [s for s in settings if s in of_level] == of_level


def test_pairs_of_few_settings_share_a_job():
    fixed = {name: values[:1] for name, values in LEVELS.items()}
    jobs = plan.jobs(PAIRS, fixed, 1, 100, 4000)
    assert [[part.pair for part in job] for job in jobs] == [PAIRS]


@pytest.mark.parametrize("runs_per_job", [300, 900, 2500, 4000])
def test_a_pair_added_at_the_end_changes_no_job_but_the_last(runs_per_job):
    pairs = [(k, k + 1) for k in range(12)]
    for number in range(1, 12):
        before, after = (
            plan.jobs(pairs[:n], LEVELS, 1, 100, runs_per_job) for n in (number, number + 1)
        )
        assert after[: len(before) - 1] == before[:-1]


def test_settings_that_share_a_reference_stand_together(monkeypatch):
    """Whatever the place of the causes that change it."""
    late = type("Late", (CAUSES["sensor_noise"],), {"name": "late", "order": 99})
    monkeypatch.setitem(CAUSES, "late", late)
    found = [s.values["late"] for s in plan.settings({**LEVELS, "late": (0.0, 0.1)}, 1)]
    by_reference = [
        (s.values["sensor_noise"], s.values["late"])
        for s in plan.settings({**LEVELS, "late": (0.0, 0.1)}, 1)
    ]
    assert by_reference == sorted(by_reference)
    assert set(found) == {0.0, 0.1}
