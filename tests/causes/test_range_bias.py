"""One error of all ranges: along the ray, the same for each point of a scan."""

import numpy as np

from icpshap.causes.range_bias import RangeBias
from icpshap.estimators.perturb import Streams

STREAMS = Streams(1, "room", 0, 1)


def test_every_range_grows_by_b_g_and_no_direction_changes(room_pair):
    for scan in ("reference", "source"):
        points = getattr(room_pair, scan)
        moved = RangeBias().move(points, scan, 0.03, 2, STREAMS)
        g = STREAMS.generator(f"bias/{scan}/2").standard_normal()
        before, after = (np.linalg.norm(cloud, axis=1) for cloud in (points, moved))
        np.testing.assert_allclose(after - before, 0.03 * g, atol=1e-12)
        np.testing.assert_allclose(moved / after[:, None], points / before[:, None], atol=1e-12)


def test_scans_and_draws_have_errors_of_their_own():
    point = np.array([[1.0, 0.0, 0.0]])
    moved = [
        RangeBias().move(point, scan, 0.03, draw, STREAMS)[0, 0]
        for scan in ("reference", "source")
        for draw in (0, 1)
    ]
    assert len(set(moved)) == 4


def test_a_point_in_the_scanner_has_no_ray_and_stays():
    assert not RangeBias().move(np.zeros((1, 3)), "source", 0.03, 0, STREAMS).any()
