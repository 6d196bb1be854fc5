"""Which runs are in a wrong basin, on clouds of which it is known."""

import numpy as np
import pytest

from icpshap.explanation.basins import find_basins

LENGTH, TRANSLATION, ROTATION = 3.0, 0.1, np.deg2rad(2.0)
WIDE = np.array([0.01, 0.01, 0.02, 0.05, 0.05, 0.03])
CORRIDOR = np.array([0.002, 0.002, 0.002, 0.4, 0.01, 0.01])
CLOUDS = {
    "gaussian": lambda generator: generator.normal(size=(100, 6)) * WIDE,
    "corridor": lambda generator: generator.normal(size=(100, 6)) * CORRIDOR,
    "student": lambda generator: generator.standard_t(5, size=(100, 6)) * WIDE,
}


def find(xi):
    return find_basins(xi, LENGTH, TRANSLATION, ROTATION)


def cloud(seed, deviation):
    """A tight cloud of 100 runs, deviation [m] in every direction at the characteristic length."""
    scale = deviation * np.repeat([1 / LENGTH, 1.0], 3)
    return np.random.default_rng(seed).normal(size=(100, 6)) * scale


@pytest.mark.parametrize("shape", CLOUDS)
def test_wide_clouds_are_one_basin(shape):
    xi = np.array([CLOUDS[shape](np.random.default_rng(seed)) for seed in range(20)])
    assert (np.linalg.norm(xi[..., 3:], axis=-1) > TRANSLATION).mean() > 0.1
    found = find(xi)
    assert found.wrong.sum(axis=1).max() <= 3
    assert not found.lacking.any()


def test_a_long_corridor_does_not_break_at_a_chance_gap():
    # Among the seeds those in which gaps alone break the corridor.
    for length, seeds in ((0.4, [127, 414, 417, 1544, 1674]), (1.0, range(300))):
        deviation = np.array([*CORRIDOR[:3], length, *CORRIDOR[4:]])
        found = find([np.random.default_rng(s).normal(size=(100, 6)) * deviation for s in seeds])
        assert found.wrong.sum(axis=1).max() <= 3
        assert not found.lacking.any()


@pytest.mark.parametrize("number", [30, 45, 49])
def test_a_basin_does_not_grow_into_the_next(number):
    # At 12 standard deviations: close enough for a few runs between them to lead from one to other.
    xi = np.array([cloud(seed, 0.05) for seed in range(200)])
    xi[:, :number] += [0.0, 0.0, 0.1, 0.5, 0.0, 0.0]
    found = find(xi)
    assert found.wrong[:, :number].sum(axis=1).min() >= number - 1
    assert not found.wrong[:, number:].any() and not found.lacking.any()


@pytest.mark.parametrize("number", [1, 2, 5, 20, 45])
def test_runs_that_are_far_are_found_and_no_others(number):
    far = np.arange(100) % 100 < number
    for seed in range(5):
        xi = cloud(seed, 0.01)
        directions = np.random.default_rng(seed).normal(size=(100, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        xi[far, 3:] += 0.8 * directions[far]
        found = find(xi)
        np.testing.assert_array_equal(found.wrong, far)
        assert not found.lacking


def test_the_smaller_of_two_basins_is_the_wrong_one():
    for deviation, number, least in ((0.01, 45, 45), (0.03, 30, 29)):
        xi = cloud(1, deviation)
        xi[:number] += [0.0, 0.0, 0.1, 0.5, 0.0, 0.0]
        wrong = find(xi).wrong
        assert wrong[:number].sum() >= least
        assert not wrong[number:].any()


def test_a_rotation_alone_is_as_far_as_what_it_moves():
    xi = cloud(2, 0.005)
    xi[7, 2] += np.deg2rad(5.0)
    assert np.flatnonzero(find(xi).wrong).tolist() == [7]


def test_what_lies_within_the_limits_is_in_no_wrong_basin():
    xi = cloud(3, 1e-4)
    xi[:9, 3] += 0.05
    assert not find(xi).wrong.any()


def test_a_cloud_that_is_equal_to_the_bit_is_one_basin():
    found = find(np.full((100, 6), 0.1))
    assert not found.wrong.any() and not found.lacking


def test_a_setting_of_many_basins_has_none_of_its_own():
    xi = cloud(6, 0.01)
    xi[:, 3] += np.arange(100) // 30
    assert find(xi).lacking
    xi[30:60, 3] -= 1.0  # now 60 of 100 lie together
    assert not find(xi).lacking


def test_failed_runs_have_no_say():
    xi = np.array([cloud(4, 0.01), cloud(5, 0.01)])
    xi[0, 3, 3] += 1.0
    expected = find(xi).wrong
    found = find(np.concatenate([xi, np.full((2, 150, 6), np.nan)], axis=1))
    np.testing.assert_array_equal(found.wrong[:, :100], expected)
    assert not found.wrong[:, 100:].any() and not found.lacking.any()
    everything = find(np.full((5, 6), np.nan))
    assert not everything.wrong.any() and not everything.lacking


def test_settings_do_not_decide_about_one_another():
    xi = np.array([cloud(seed, 0.02) for seed in range(70)])
    xi[::3, :5, 4] += 0.4
    xi[1, 9] = np.nan
    together = find(xi)
    for one, wrong, lacking in zip(xi, *together, strict=True):
        alone = find(one)
        np.testing.assert_array_equal(alone.wrong, wrong)
        assert alone.lacking == lacking
