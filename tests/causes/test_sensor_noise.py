"""White noise on both clouds, and the released code's second helping on the reference."""

import numpy as np
import pytest

from icpshap.causes._sensors import ACCURACY, SENSORS, SIGMA
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


def test_with_a_scanner_the_level_multiplies_what_is_published_at_each_range():
    points = np.random.default_rng(0).normal(size=(500, 3)) * 40
    moved = SensorNoise(sensor="hokuyo_utm_30lx").move(points, "source", 2.0, 3, STREAMS)
    sigma = np.maximum(0.018, 0.0006 * np.linalg.norm(points, axis=1) + 0.0015)
    assert 1 < (sigma > 0.018).sum() < 500
    draw = STREAMS.generator("noise/source/3").standard_normal(points.shape)
    np.testing.assert_allclose(moved, points + 2.0 * sigma[:, None] * draw, rtol=1e-13)


@pytest.mark.parametrize("sensor", SENSORS.values(), ids=SENSORS)
def test_every_scanner_says_what_is_published_and_where(sensor):
    assert sensor.says in (SIGMA, ACCURACY) and sensor.title and sensor.source and sensor.formula
    published = sensor.published(np.array([0.5, 5.0, 12.0, 29.0]))
    assert ((published > 0.001) & (published < 0.25)).all() and (np.diff(published) >= 0).all()


def test_the_level_of_a_scanner_has_no_unit():
    usual, factor = SensorNoise(), SensorNoise(sensor="velodyne_vlp_16")
    assert usual.label() == "sensor noise σ [m]"
    assert (factor.unit, factor.symbol) == ("", "σ/σ₀")
    assert SensorNoise.unit == "m"
