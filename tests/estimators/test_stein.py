"""Stein ICP against the authors' program, and as a sampler of a known density."""

import numpy as np
import pytest
from drawn_samples import CLEAN, STREAMS, clouds, expected, runs

from icpshap import icp, se3
from icpshap.estimators import stein
from icpshap.estimators._point_to_point import (
    errors,
    minibatches,
    pose_of,
    rotations,
    transformation_of,
)
from icpshap.estimators.stein import Stein

# Options and batch of each configuration of the oracle whose kernel width is not differentiated.
CONFIGURATIONS = {
    "default_h_detached": (Stein(), 150),
    "unnormalised_h_detached": (Stein(normalise=False, maximum_distance=0.25), 150),
    "notebook_h_detached": (Stein(maximum_distance=2.8), 50),
}


@pytest.mark.parametrize("coalition", ["000", "111"])
@pytest.mark.parametrize("configuration", CONFIGURATIONS)
def test_particles_are_those_of_the_authors_program(configuration, coalition):
    given = expected("stein_icp.npz")
    kind, size = CONFIGURATIONS[configuration]
    reference, source = clouds(coalition)
    posterior = kind.posterior(
        source,
        np.arange(len(source)),
        reference,
        icp.Matcher(icp.Reference(reference)),
        given[f"minibatch_rows_{coalition}"][:size, :size],
    )
    particles = posterior.normalised(given[f"initial_{coalition}"])
    compared = 0
    for number, now in enumerate(stein.moved(particles, posterior.score, size, 0.01), start=1):
        name = f"{configuration}_{coalition}_after_{number}"
        if name in given:
            np.testing.assert_allclose(posterior.metric(now), given[name], rtol=0, atol=1e-12)
            compared += 1
    assert compared == (8 if size == 150 else 6)


def test_particles_recover_a_gaussian():
    mean, deviation = np.array([1.0, -2.0]), np.array([0.5, 2.0])
    start = np.random.default_rng(0).normal(size=(100, 2))

    def score(iteration, particles):
        return (mean - particles) / deviation**2

    *_, found = stein.moved(start, score, 1500, 0.05)
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.05)
    np.testing.assert_allclose(found.std(axis=0), deviation, rtol=0.1)


def test_a_wide_likelihood_spreads_the_particles(room_pair):
    spread = [
        np.linalg.slogdet(
            np.cov(
                runs(room_pair, [CLEAN], "stein", particles=20, likelihood_sigma=sigma).filter(
                    regex=r"^xi_"
                ),
                rowvar=False,
            )
        )[1]
        for sigma in (0.1, 1.0)
    ]
    assert spread[0] < spread[1] - 6


def test_gradients_are_those_of_half_the_mean_squared_error(room_pair):
    generator = np.random.default_rng(2)
    source = room_pair.source[:200]
    poses = pose_of(room_pair.T_reference_source) + 0.02 * generator.normal(size=(3, 6))
    match = icp.Matcher(icp.Reference(room_pair.reference))

    def half_mean_square(poses):
        return errors(poses, source, room_pair.reference, match, np.inf).rmse ** 2 / 2

    found = errors(poses, source, room_pair.reference, match, np.inf)
    for axis in range(6):
        step = 1e-6 * np.eye(6)[axis]
        difference = (half_mean_square(poses + step) - half_mean_square(poses - step)) / 2e-6
        np.testing.assert_allclose(found.gradient[:, axis], difference, atol=1e-6)


def test_of_links_to_one_point_the_closest_counts_and_the_first_on_ties():
    reference = np.array([[0.0, 0, 0], [10.0, 0, 0]])
    source = np.array([[0.3, 0, 0], [0.1, 0, 0], [10.2, 0, 0], [0.1, 0, 0], [5.0, 9.0, 0]])
    match = icp.Matcher(icp.Reference(reference))
    found = errors(np.zeros((1, 6)), source, reference, match, 1.0, closest_only=True)
    assert found.links[0] == 2
    np.testing.assert_allclose(found.gradient[0, :3], [(0.1 + 0.2) / 2, 0, 0], atol=1e-12)


def test_poses_are_euler_angles_and_back():
    T = se3.exp(np.random.default_rng(0).normal(size=(20, 6)))
    poses = pose_of(T)
    np.testing.assert_allclose(transformation_of(poses), T, atol=1e-12)
    np.testing.assert_allclose(rotations(poses[:, 3:])[0], T[:, :3, :3], atol=1e-12)


def test_angles_do_not_jump_by_a_turn():
    """Poses about a half turn: without a centre their yaws would lie at both ends, 2 pi apart."""
    centre = np.array([0, 0, np.pi - 0.01, 0, 0, 0])
    T = se3.exp(centre) @ se3.exp(0.05 * np.random.default_rng(0).normal(size=(50, 6)))
    assert np.ptp(pose_of(T)[:, 5]) > 6
    assert np.ptp(pose_of(T, pose_of(se3.exp(centre)))[:, 5]) < 1


def test_a_row_that_is_not_usable_any_more_changes_only_its_own_batches():
    rows = np.arange(100, 400)
    before = minibatches(STREAMS, 0, 50, 20, rows, 1000)
    after = minibatches(STREAMS, 0, 50, 20, rows[rows != 250], 1000)
    used = (before == 250).any(axis=1)
    assert 0 < used.sum() < 50
    np.testing.assert_array_equal(before[~used], after[~used])
    assert (after != 250).all()
    for had, has in zip(before[used], after[used], strict=True):
        left = had[had != 250]
        np.testing.assert_array_equal(has[: len(left)], left)


def test_batches_are_of_the_stream_of_their_iteration():
    batches = minibatches(STREAMS, 0, 5, 20, np.arange(30), 30_000)
    assert batches.shape == (5, 20) and batches.max() < 30
    np.testing.assert_array_equal(
        minibatches(STREAMS, 3, 2, 20, np.arange(30), 30_000), batches[3:]
    )


def test_particles_that_still_shrink_are_said_to(room_pair):
    """After 30 iterations of a sharp likelihood they do; after many of a wide one they rest."""
    few, many = (
        runs(room_pair, [CLEAN], "stein", particles=20, **values)
        for values in (
            {"iterations": 30, "likelihood_sigma": 0.1},
            {"iterations": 200, "likelihood_sigma": 5.0, "normalise": False},
        )
    )
    assert (few["status"] == "max_iterations").all()
    assert (many["status"] == "ok").all()
    particles = np.random.default_rng(0).normal(size=(30, 6))
    assert stein.still_shrinks(particles, 0.85 * particles)
    assert not stein.still_shrinks(particles, 0.95 * particles)
