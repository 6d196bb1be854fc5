"""A twist during the scan: by the time of each point, whatever the order of the rows."""

from dataclasses import replace

import numpy as np
import pytest

from icpshap.causes.motion_distortion import MotionDistortion
from icpshap.errors import PerturbationError
from icpshap.estimators.perturb import Streams

STREAMS = Streams(1, "room", 0, 1)


def moved(pair, level=0.1, draw=0, **options):
    return (
        MotionDistortion(**options).of_pair(pair).move(pair.source, "source", level, draw, STREAMS)
    )


@pytest.fixture
def timed(room_pair):
    times = np.random.default_rng(0).uniform(100.0, 103.0, len(room_pair.source))
    return replace(room_pair, source_times=times)


def test_a_point_moves_by_tau_times_its_twist(timed):
    times, points = timed.source_times, timed.source
    tau = (times - (times.min() + times.max()) / 2) / (times.max() - times.min())
    np.testing.assert_allclose([tau.min(), tau.max()], [-0.5, 0.5])
    normal = STREAMS.generator("twist/3").standard_normal(6) / np.sqrt(3)
    w, v = 0.2 * 0.1 * normal[:3], 0.1 * normal[3:]
    expected = points + tau[:, None] * (np.cross(w, points) + v)
    np.testing.assert_allclose(moved(timed, draw=3), expected, atol=1e-12)


def test_twists_have_the_variances_of_the_definition():
    """d^2/3 on each axis of v, and (0.2 d)^2/3 on each of w, read off points at known places."""
    points, times = np.array([[0.0, 0, 0], [0, 0, 0], [0, 0, 1.0]]), np.array([0.0, 2.0, 2.0])
    cause = MotionDistortion(times=times)
    shifts, turns = [], []
    for draw in range(4000):
        away = cause.move(points, "source", 0.3, draw, STREAMS) - points
        np.testing.assert_allclose(away[0], -away[1])
        shifts.append(2 * away[1])
        turns.append(2 * (away[2] - away[1])[:2])  # w x e_z = (w_y, -w_x, 0)
    np.testing.assert_allclose(np.var(shifts, axis=0), 0.3**2 / 3, rtol=0.1)
    np.testing.assert_allclose(np.var(turns, axis=0), (0.2 * 0.3) ** 2 / 3, rtol=0.1)


@pytest.mark.parametrize("options", [{}, {"scan_order": "tilt"}, {"scan_order": "azimuth"}])
def test_rows_may_be_in_any_order(room_pair, timed, options):
    pair = room_pair if options else timed
    order = np.random.default_rng(1).permutation(len(pair.source))
    times = None if options else pair.source_times[order]
    shuffled = replace(pair, source=pair.source[order], source_times=times)
    np.testing.assert_array_equal(moved(shuffled, **options), moved(pair, **options)[order])


def test_without_times_the_geometry_gives_the_order():
    """A fan tilted about the y axis sees behind the scanner what is on the same plane."""
    angle = np.deg2rad([-40.0, -40.0, 0.0, 40.0, 40.0])
    forward = np.array([1.0, -1.0, 1.0, 1.0, -1.0])
    tilted = np.stack([np.cos(angle) * forward, 0.3 * forward, -np.sin(angle) * forward], 1)
    tau = MotionDistortion(scan_order="tilt")._phase(tilted)
    np.testing.assert_allclose(tau, [-0.5, -0.5, 0.0, 0.5, 0.5], atol=1e-12)
    turned = np.stack([np.cos(angle), np.sin(angle), forward], axis=1)
    tau = MotionDistortion(scan_order="azimuth")._phase(turned)
    np.testing.assert_allclose(tau, [-0.5, -0.5, 0.0, 0.5, 0.5], atol=1e-12)


def test_the_scans_own_times_come_before_the_geometry(timed, room_pair):
    assert not np.array_equal(moved(timed), moved(room_pair))


def test_points_without_an_order_are_refused(room_pair):
    flat = replace(room_pair, source=room_pair.source * [1, 1, 0])
    MotionDistortion(scan_order="azimuth").check(flat, 0.1)
    with pytest.raises(PerturbationError, match=r"have the same tilt, .*\nHint: .*scan_order"):
        MotionDistortion().check(flat, 0.1)
