"""SVN-ICP against the authors' program and an independent one."""

import numpy as np
import pytest
from drawn_samples import CLEAN, clouds, expected, runs
from scipy.spatial import KDTree

from icpshap import icp, se3
from icpshap.estimators import stein_newton
from icpshap.estimators.stein_newton import SteinNewton

COALITIONS = pytest.mark.parametrize("coalition", ["000", "111"])


def nearest_of_all(reference):
    match = icp.Matcher(icp.Reference(reference))

    def nearest(points):
        squared, rows = match(points, 3.0)
        return squared[:, 0], reference[rows[:, 0]]

    return nearest


@COALITIONS
def test_particles_are_those_of_the_independent_program(coalition):
    """After some iterations, and where they stop."""
    given = expected("svn_icp.npz")
    reference, _ = clouds(coalition)
    source, T_mean, initial = (
        given[f"source_{coalition}"],
        given["T0"],
        given[f"initial_{coalition}"],
    )
    nearest = nearest_of_all(reference)

    def moved(**options):
        return SteinNewton(**options).moved(T_mean @ initial, T_mean, source, nearest)

    for number in (1, 2, 5, 10):
        found = moved(maximum_iterations=number, stop=0.0)
        assert (found.status == "max_iterations").all()
        relative = se3.inverse(T_mean) @ found.T_reference_source
        theirs = given[f"after_{number}_{coalition}"]
        np.testing.assert_allclose(relative[:, :3, :3].reshape(-1, 9), theirs[:, :9], atol=1e-12)
        np.testing.assert_allclose(relative[:, :3, 3], theirs[:, 9:], atol=1e-12)
    found = moved()
    assert found.iterations == given[f"iterations_{coalition}"]
    assert (found.status == "ok").all()
    relative = se3.inverse(T_mean) @ found.T_reference_source
    np.testing.assert_allclose(relative, given[f"final_{coalition}"], rtol=0, atol=1e-12)


@pytest.mark.parametrize("curvature", ["mean", pytest.param("full", marks=pytest.mark.slow)])
@COALITIONS
def test_particles_are_those_of_the_authors_program(coalition, curvature):
    """With its candidates: of each point the 100 reference points nearest to it at T0."""
    given = expected("svn_icp.npz")
    reference, _ = clouds(coalition)
    source, T_mean, initial = (
        given[f"source_{coalition}"],
        given["T0"],
        given[f"initial_{coalition}"],
    )
    candidates = reference[KDTree(reference).query(se3.transform(T_mean, source), k=100)[1]]

    def nearest(points):
        of_particles = points.reshape(-1, len(source), 3)
        squared = np.square(candidates - of_particles[:, :, None]).sum(axis=-1)
        best = squared.argmin(axis=-1)
        matched = candidates[np.arange(len(source)), best]
        return squared.min(axis=-1).ravel(), matched.reshape(-1, 3)

    for number in (1, 5, 20):
        kind = SteinNewton(maximum_iterations=number, stop=0.0, curvature=curvature)
        found = kind.moved(T_mean @ initial, T_mean, source, nearest)
        relative = stein_newton.coordinates(se3.inverse(T_mean) @ found.T_reference_source)
        theirs = given[f"authors_{curvature}_{coalition}_after_{number}"]
        np.testing.assert_allclose(relative, theirs, rtol=0, atol=1e-12)


def test_equations_are_those_of_the_jacobian():
    """Sums over points against J^T J and J^T e, J = [R, -R [s]x]; the last link is rejected."""
    generator = np.random.default_rng(0)
    T = se3.exp(generator.normal(size=(2, 6)))
    source = generator.normal(size=(5, 3))
    points = source @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
    error = 0.3 * generator.normal(size=(2, 5, 3))
    error[:, 4] = 5.0

    def nearest(moved):
        return np.square(error).sum(axis=-1).ravel(), (points - error).reshape(-1, 3)

    found = stein_newton.linearise(T, source, nearest, 3.0)
    for k, rotation in enumerate(T[:, :3, :3]):
        hessian, gradient = 1e-6 * np.eye(6), np.zeros(6)
        hessian[:3, :3] += np.eye(3)  # of the rejected link
        for s, e in zip(source[:4], error[k, :4], strict=True):
            J = np.concatenate([rotation, -rotation @ se3.hat(s)], axis=1)
            weight = (3 / (3 + 3 * np.linalg.norm(e))) ** 2
            hessian += weight * J.T @ J
            gradient += weight * J.T @ e
        np.testing.assert_allclose(found.hessian[k], hessian, atol=1e-12)
        np.testing.assert_allclose(found.gradient[k], gradient, atol=1e-12)
    assert (found.links == 4).all()
    np.testing.assert_allclose(found.rmse**2, np.square(error[:, :4]).sum(axis=(1, 2)) / 4)


def test_particles_find_the_mean_of_a_gaussian_and_spread_about_it():
    """Constant Hessians. The spread is in the right order only: the kernel knows no Hessian."""
    hessian = np.diag([4.0, 25.0])
    particles = np.random.default_rng(0).normal(size=(40, 2))
    mean = np.array([1.0, -2.0])
    for _ in range(300):
        gradient = (particles - mean) @ hessian
        steps = stein_newton.newton_steps(particles, np.tile(hessian, (40, 1, 1)), gradient)
        particles = particles + 0.2 * steps
    np.testing.assert_allclose(particles.mean(axis=0), mean, atol=0.02)
    np.testing.assert_allclose(particles.std(axis=0), [1 / 2, 1 / 5], rtol=0.15)


def test_particles_that_did_not_stop_say_so(room_pair):
    few = runs(room_pair, [CLEAN], "stein_newton", maximum_iterations=2)
    assert (few["status"] == "max_iterations").all() and few["iterations"].eq(2).all()
    every = runs(room_pair, [CLEAN], "stein_newton", stop=0.02)
    assert (every["status"] == "ok").all() and every["iterations"].max() < 100


def test_more_points_make_a_smaller_spread(room_pair):
    """A link has the variance 1 m^2, so that the spread falls as the root of their number."""
    spread = [
        runs(room_pair, [CLEAN], "stein_newton", subsampling_probability=share)["xi_3"].std()
        for share in (0.1, 1.0)
    ]
    assert 2 < spread[0] / spread[1] < 5
