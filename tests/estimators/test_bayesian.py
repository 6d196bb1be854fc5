"""Bayesian ICP against the authors' program, step by step, and as a sampler of a known density."""

import numpy as np
import pandas as pd
import pytest
from drawn_samples import CLEAN, clouds, expected, runs
from scipy.optimize import brentq

from icpshap import config as configuration
from icpshap import icp
from icpshap.estimators import bayesian
from icpshap.estimators._point_to_point import Errors, errors
from icpshap.estimators.bayesian import Prior
from icpshap.explanation.chains import effective_sample_size

LOGGED = 400  # iterations whose draws the oracle has


@pytest.mark.parametrize("variant", [1, 2])
@pytest.mark.parametrize("coalition", ["000", "111"])
def test_each_step_is_that_of_the_authors_program(coalition, variant):
    """From the pose that theirs had reached: the chain is chaotic in round-off.

    To 1e-8, since their normal numbers were logged with ten digits. Where a link is longer than
    1 m their program removes duplicates by positions from before the long links were removed, and
    so the wrong ones; there the gradient is solved from their step, so that the running mean of
    squares goes on as theirs.
    """
    given = expected("bayesian_icp.npz")
    reference, source = clouds(coalition)
    match = icp.Matcher(icp.Reference(reference))
    poses = given[f"chain_{coalition}_method{variant}"]
    normals = given[f"normals_{coalition}_method{variant}"]
    batches = given[f"batch_rows_{coalition}_method{variant}"]
    pose, square = given[f"initial_{coalition}"], np.zeros(6)
    prior = Prior(pose, np.full(6, 0.125))
    compared = 0
    for iteration in range(LOGGED):
        batch, theirs = source[batches[iteration]], poses[iteration]
        found = errors(pose[None], batch, reference, match, 1.0, closest_only=True)
        every = errors(pose[None], batch, reference, match, 1.0)

        def step(gradient, pose=pose, square=square, iteration=iteration):
            return bayesian.step(
                pose,
                square,
                gradient,
                prior.gradient(pose),
                len(source),
                normals[iteration],
                variant,
            )

        gradient = found.gradient[0]
        if every.links[0] < len(batch):
            gradient = solved(step, theirs, gradient)
        else:
            np.testing.assert_allclose(step(gradient)[0], theirs, rtol=0, atol=1e-8)
            compared += 1
        square = step(gradient)[1]
        pose = theirs
    assert compared > 250


def solved(step, theirs, near):
    """The gradient (6,) that makes their step, of several the one nearest to `near`."""

    def function(gradient):
        return step(gradient)[0] - theirs

    grid = near + np.linspace(-0.3, 0.3, 6001)[:, None]
    values = function(grid)
    result = near.copy()
    for axis in range(6):
        signs = np.flatnonzero(values[:-1, axis] * values[1:, axis] < 0)
        roots = [
            brentq(
                lambda g: function(np.full(6, g))[axis],  # noqa: B023
                grid[k, axis],
                grid[k + 1, axis],
                xtol=1e-15,
            )
            for k in signs
        ]
        result[axis] = min(roots, key=lambda root: abs(root - near[axis]), default=near[axis])
    return result


def test_the_chain_recovers_a_quadratic():
    """Density exp(-N a x^2 / 2) of each of six coordinates.

    Two things that the released step does are expected: a tenth of the running mean of squares is
    the gradient of the step itself, which weakens its pull by a tenth; and the gradients' own
    noise, of one size and either sign, comes to that of the chain.
    """
    points, curvature, deviation = 10, 0.1, 0.3
    generator = np.random.default_rng(0)
    noise = deviation * generator.choice([-1, 1], size=(40_000, 6))

    def likelihood(iteration, pose):
        gradient = curvature * pose + noise[iteration]
        return Errors(gradient[None], np.array([100]), np.array([0.0]))

    prior = Prior(np.zeros(6), np.full(6, 1e6))
    normals = generator.normal(size=noise.shape)
    found = bayesian.chain(np.zeros(6), likelihood, prior, points, normals, 1)
    assert (found.status == "ok").all()
    states = found.states[1000:]
    np.testing.assert_allclose(states.mean(axis=0), 0, atol=0.3)
    size = 0.06147 / (points * deviation)
    of_gradients = size / 4 * (points * deviation) ** 2
    variance = (1 + of_gradients) / (0.9 * points * curvature)
    assert states.var(axis=0).mean() == pytest.approx(variance, rel=0.1)


def test_a_skipped_iteration_stays_and_says_so():
    def likelihood(iteration, pose):
        return Errors(np.ones((1, 6)), np.array([2 if iteration == 1 else 3]), np.zeros(1))

    prior = Prior(np.zeros(6), np.ones(6))
    found = bayesian.chain(np.zeros(6), likelihood, prior, 100, np.zeros((3, 6)), 1)
    assert list(found.status) == ["ok", "too_few_links", "ok"]
    np.testing.assert_array_equal(found.states[0], found.states[1])
    assert (found.states[1] != found.states[2]).all()


def test_a_chain_that_leaves_the_numbers_is_degenerate():
    def likelihood(iteration, pose):
        return Errors(np.full((1, 6), np.nan), np.array([3]), np.zeros(1))

    prior = Prior(np.zeros(6), np.ones(6))
    found = bayesian.chain(np.ones(6), likelihood, prior, 100, np.zeros((3, 6)), 1)
    assert (found.status == "degenerate").all()
    assert (found.states == 1).all()


def test_the_prior_can_be_that_of_the_initial_poses(room_pair):
    """Where these have the released variance, the same chain."""
    few = {"iterations": 20, "burn_in": 5, "deviation": np.full(6, np.sqrt(0.125))}
    released = runs(room_pair, [CLEAN], "bayesian", **few)
    of_poses = runs(room_pair, [CLEAN], "bayesian", prior="initial_pose", **few)
    numbers = released.select_dtypes("number").columns
    np.testing.assert_allclose(released[numbers], of_poses[numbers], atol=1e-6)
    few["deviation"] = 0.01 * few["deviation"]
    narrow = runs(room_pair, [CLEAN], "bayesian", prior="initial_pose", **few)
    assert not np.isclose(narrow["xi_0"], runs(room_pair, [CLEAN], "bayesian", **few)["xi_0"]).any()


def test_every_state_after_the_burn_in_is_a_sample(room_pair):
    every = runs(room_pair, [CLEAN], "bayesian", iterations=30, burn_in=0)
    later = runs(room_pair, [CLEAN], "bayesian", iterations=30, burn_in=10)
    assert list(later["run"]) == list(range(20))
    assert list(later["iterations"]) == list(range(11, 31))
    xi = [name for name in every if name.startswith("xi_")]
    pd.testing.assert_frame_equal(every[xi][10:].reset_index(drop=True), later[xi])


def test_a_burn_in_that_leaves_too_few_samples_is_refused(config):
    config["estimators"]["chain"] = {"kind": "bayesian", "iterations": 100, "burn_in": 95}
    with pytest.raises(
        configuration.ConfigError, match=r"chain\.burn_in: 95 of 100 iterations leave 5 samples"
    ):
        configuration.load(config)


def test_the_effective_size_of_an_autoregressive_chain():
    """n (1 - rho) / (1 + rho) for x_t = rho x_t-1 + noise; the smallest of the coordinates."""
    generator = np.random.default_rng(0)
    n, rho = 40_000, np.array([0.0, 0.5, 0.9])
    states = generator.normal(size=(n, 3))
    for t in range(1, n):
        states[t] += rho * states[t - 1]
    for column, factor in enumerate(rho):
        found = effective_sample_size(states[:, [column]])
        assert found == pytest.approx(n * (1 - factor) / (1 + factor), rel=0.1)
    assert effective_sample_size(states) == effective_sample_size(states[:, [2]])


def test_a_coordinate_that_rests_is_worth_one_sample():
    states = np.random.default_rng(0).normal(size=(100, 2))
    states[:, 1] = 3.0
    assert effective_sample_size(states) == 1
