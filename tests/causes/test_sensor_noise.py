"""White noise on both clouds, and the released code's second helping on the reference."""

import numpy as np
import pytest

from icpshap.causes.sensor_noise import SensorNoise
from icpshap.estimators.perturb import Streams

STREAMS = Streams(1, "room", 0, 1)


def test_noise_is_sigma_times_one_normal_draw_on_every_coordinate(room_pair):
    points = room_pair.source
    moved = SensorNoise().move(points, "source", 0.05, 3, STREAMS)
    draw = STREAMS.generator("noise/source/3").standard_normal(points.shape)
    np.testing.assert_array_equal(moved, points + 0.05 * draw)


def test_scans_and_draws_have_noise_of_their_own(room_pair):
    points = room_pair.reference
    moved = [
        SensorNoise().move(points, scan, 0.05, draw, STREAMS)
        for scan in ("reference", "source")
        for draw in (0, 1)
    ]
    assert len({cloud.tobytes() for cloud in moved}) == 4


def test_twice_added_noise_is_sqrt_two_larger_on_the_reference_alone(room_pair):
    twice = SensorNoise(reference_noise_additions=2)
    for scan, factor in (("reference", np.sqrt(2)), ("source", 1.0)):
        points = getattr(room_pair, scan)
        moved = twice.move(points, scan, 0.05, 0, STREAMS)
        assert np.std(moved - points) == pytest.approx(0.05, rel=0.03)
        seen = twice.move_again(moved, scan, 0.05, 0, STREAMS)
        assert np.std(seen - points) == pytest.approx(0.05 * factor, rel=0.03)


def test_once_is_what_is_seen(room_pair):
    points = room_pair.reference
    assert SensorNoise().move_again(points, "reference", 0.05, 0, STREAMS) is points
