"""The sensor's own noise in Monte Carlo: in every setting, drawn or in closed form."""

import numpy as np
import pandas as pd
import pytest
from estimated_room import DEVIATION, NAMES, STREAMS, covariances, setting

from icpshap import estimators, icp
from icpshap.estimators import Estimator, closed_form, perturb
from icpshap.estimators.kind import SAMPLES

OWN = 0.01
OPTIONS = {
    "runs": 50,
    "noise_draws": 10,
    "subsampling_probability": 0.1,
    "normal_neighbours": 12,
    "sensor_sigma": OWN,
}


def estimator(**changes):
    return Estimator.of("monte_carlo", {**OPTIONS, **changes}).of_causes(NAMES)


def groups(pair, of, *levels):
    given = ([setting(*row) for row in levels], of, DEVIATION, STREAMS)
    return [
        (group, starts) for group in perturb.groups(pair, *given) for starts in [list(group.starts)]
    ]


def table_of(pair, of, *levels):
    return estimators.estimate(pair, [setting(*row) for row in levels], of, DEVIATION, STREAMS)


def noise_of(name, points, sigma):
    return sigma * STREAMS.generator(name).standard_normal(points.shape)


@pytest.mark.parametrize("level", [0.0, 0.03])
def test_both_scans_get_it_in_every_draw_from_the_draws_of_the_setting(room_pair, level):
    of = estimator(minimum_range=0.0)
    found = groups(room_pair, of, (level, 1.0, 0.0))
    assert len(found) == 10
    for group, (start,) in found:
        for scan, points in (("reference", group.reference), ("source", start.source)):
            raw = getattr(room_pair, scan)
            noise = noise_of(f"noise/{scan}/{group.noise_draw}", raw, np.hypot(OWN, level))
            np.testing.assert_allclose(points, raw + noise, rtol=0, atol=1e-12)


def test_the_released_codes_second_noise_does_not_hold_it_twice(room_pair):
    of = estimator(minimum_range=0.0, reference_noise_additions=2)
    for level in (0.0, 0.03):
        group, _ = groups(room_pair, of, (level, 1.0, 0.0))[0]
        raw = room_pair.reference
        noise = noise_of("noise/reference/0", raw, np.hypot(OWN, level))
        noise = noise + noise_of("noise/reference_again/0", raw, level)
        np.testing.assert_allclose(group.reference, raw + noise, rtol=0, atol=1e-12)
        np.testing.assert_allclose(group.reference_variance, OWN**2 + 2 * level**2)
    assert of.returned.sensor_sigma == 0  # no factor is that of both scans


def test_it_is_there_where_the_experiment_names_no_sensor_noise(room_pair):
    of = Estimator.of("monte_carlo", OPTIONS).of_causes(["initial_pose"])
    assert list(of.causes) == ["sensor_noise", "initial_pose"]
    only = perturb.Setting.at({"initial_pose": 1.0})
    (first, *_) = perturb.groups(room_pair, [only], of, DEVIATION, STREAMS)
    with_noise = groups(room_pair, estimator(), (0.0, 1.0, 0.0))[0][0]
    np.testing.assert_array_equal(first.reference, with_noise.reference)
    assert Estimator.decided(of.decides()) == of


def test_removed_points_are_those_that_are_removed_without_it(room_pair):
    drawn, without = (
        groups(room_pair, estimator(sensor_sigma=own), (0.0, 1.0, 0.05)) for own in (OWN, 0.0)
    )
    for (_, (one,)), (_, (other,)) in zip(drawn, without, strict=True):
        assert one.source.shape == other.source.shape
        assert abs(one.usable.sum() - other.usable.sum()) < 20  # at the edge of the minimum range
        assert (one.usable == other.usable).mean() > 0.99


def test_draws_spread_the_clean_runs(room_pair):
    """Each draw rests elsewhere; without it all runs of all points rest at one pose."""
    tight = {"subsampling_probability": 1, "stop_rotation": 1e-7, "stop_translation": 1e-7}
    spread = []
    for own in (OWN, 0.0):
        of = estimator(sensor_sigma=own, **tight)
        runs, estimates = table_of(room_pair, of, (0.0, 1.0, 0.0))
        assert estimates is None
        xi = [f"xi_{k}" for k in range(6)]
        spread.append(runs.groupby("noise_draw")[xi].median().std())
    assert (spread[0] > 1e-4).all() and (spread[1] < 1e-5).all()


CLOSED = {"sensor_noise_by": "closed_form", "noise_draws": 1}


class TestClosedForm:
    def test_runs_are_those_without_it(self, room_pair):
        levels = [(0.0, 1.0, 0.0), (0.03, 1.5, 0.05)]
        runs, estimates = table_of(room_pair, estimator(**CLOSED), *levels)
        plain, nothing = table_of(room_pair, estimator(**CLOSED, sensor_sigma=0.0), *levels)
        pd.testing.assert_frame_equal(runs, plain)
        assert nothing is None
        assert len(estimates) == 2 and (estimates["status"] != "degenerate").all()

    @pytest.mark.parametrize("draws", [1, 2])
    def test_it_is_that_of_all_usable_points_and_of_what_runs_do_not_vary(self, room_pair, draws):
        """With one noise draw the noise of the setting is in no run's spread: it is told, too."""
        level = 0.03
        of = estimator(sensor_noise_by="closed_form", noise_draws=draws)
        _, estimates = table_of(room_pair, of, (level, 1.5, 0.0))
        variance = OWN**2 + (draws == 1) * level**2
        T_true = room_pair.T_reference_source
        for number, (group, (start,)) in enumerate(groups(room_pair, of, (level, 1.5, 0.0))):
            reference = icp.Reference(group.reference, 12)
            rows = np.flatnonzero(start.usable)
            run = icp.register(reference, start.source, [rows], T_true[None], of.kind.chain())
            expected = closed_form.of_clouds(
                reference,
                start.source[rows],
                run.T_reference_source[0],
                of.kind.chain(),
                np.full(len(rows), variance),
                np.full(len(group.reference), variance),
            )
            row = estimates[estimates["noise_draw"] == number]
            np.testing.assert_allclose(covariances(row)[0], expected.covariance, rtol=1e-9)

    def test_it_says_what_comes_back(self):
        returned = estimator(**CLOSED).returned
        assert (returned.samples, returned.covariances) == (True, True)
        assert returned.sensor_sigma == OWN and returned.together and not returned.drawn
        assert not estimator(sensor_noise_by="closed_form").returned.together
        assert estimator().returned.drawn and not estimator().returned.covariances
        assert estimator(sensor_sigma=0.0).returned == SAMPLES
        # A scanner's model varies from point to point: no factor tells what another noise would do.
        assert estimator(sensor="hokuyo_utm_30lx").returned.sensor_sigma == 0.0
