"""Which settings are run, and how they are cut into jobs."""

from itertools import chain

import pytest

from icpshap import plan

LEVELS = {
    "sensor_noise": (0.02, 0.05),
    "initial_pose": (1.0, 1.5),
    "partial_overlap": (0.0, 0.05, 0.1),
}


def test_settings_are_the_levels_and_the_reference_values_each_once():
    found = [s.values for s in plan.settings(LEVELS, 1) if not s.again]
    assert len(found) == len(set(found)) == 3 * 2 * 3
    assert {values[0] for values in found} == {0.0, 0.02, 0.05}


def test_every_coalition_of_every_instance_is_a_setting():
    found = {s.values for s in plan.settings(LEVELS, 1)}
    off = (0.0, 1.0, 0.0)
    for instance in plan.instances(LEVELS):
        for mask in range(8):
            on = tuple(instance[k] if mask >> k & 1 else off[k] for k in range(3))
            assert on in found


def test_one_second_clean_sample_for_each_replicate():
    again = [s for s in plan.settings(LEVELS, 3) if s.again]
    assert [(s.values, s.replicate) for s in again] == [((0.0, 1.0, 0.0), k) for k in range(3)]


@pytest.mark.parametrize("runs_per_job", [1, 100, 250, 700, 10_000])
def test_jobs_hold_every_setting_once_and_stay_small(runs_per_job):
    jobs = plan.jobs(LEVELS, 2, runs=100, runs_per_job=runs_per_job)
    assert list(chain.from_iterable(jobs)) == plan.settings(LEVELS, 2)
    assert all(0 < len(job) <= max(1, runs_per_job // 100) for job in jobs)


def test_noise_levels_stay_whole_where_they_fit():
    jobs = plan.jobs(LEVELS, 1, runs=100, runs_per_job=800)
    for job in jobs:
        for level in {s.values[0] for s in job}:
            assert sum(s.values[0] == level for s in plan.settings(LEVELS, 1)) == sum(
                s.values[0] == level for s in job
            )


def test_a_pair_of_few_settings_is_one_job():
    assert len(plan.jobs({key: values[:1] for key, values in LEVELS.items()}, 1, 100, 4000)) == 1
