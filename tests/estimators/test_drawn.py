"""What holds for every kind that draws dependent samples: particles and chains."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from drawn_samples import (
    CLEAN,
    DEVIATION,
    NAMES,
    NOISY,
    SETTINGS,
    SPREAD,
    STREAMS,
    of,
    runs,
)

from icpshap.estimators import Estimator, perturb
from icpshap.tables import INITIAL_XI, TRANSFORM, XI

KINDS = {
    "stein": {"particles": 10, "iterations": 15, "batch": 40},
    "bayesian": {"iterations": 30, "burn_in": 10, "batch": 40},
    "stein_newton": {"particles": 10, "maximum_iterations": 10},
}
EVERY = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(scope="module")
def table(room_pair):
    made = {}

    def of_kind(kind):
        if kind not in made:
            made[kind] = runs(room_pair, SETTINGS, kind, **KINDS[kind])
        return made[kind]

    return of_kind


@EVERY
def test_the_company_of_a_setting_does_not_change_a_byte(kind, table, room_pair):
    turned = runs(room_pair, SETTINGS[::-1], kind, **KINDS[kind])
    alone = runs(room_pair, [NOISY], kind, **KINDS[kind])
    for setting in SETTINGS:
        pd.testing.assert_frame_equal(
            of(table(kind), setting), of(turned, setting), check_exact=True
        )
    pd.testing.assert_frame_equal(of(table(kind), NOISY), of(alone, NOISY), check_exact=True)


@EVERY
def test_settings_share_their_draws(kind, table):
    clean, spread = of(table(kind), CLEAN), of(table(kind), SPREAD)
    np.testing.assert_allclose(spread[INITIAL_XI], np.sqrt(2) * clean[INITIAL_XI])


@EVERY
def test_a_noise_draw_does_not_depend_on_their_number(kind, table, room_pair):
    twice = runs(room_pair, [NOISY], kind, noise_draws=2, **KINDS[kind])
    once = of(table(kind), NOISY)
    first, second = (twice[twice["noise_draw"] == k].reset_index(drop=True) for k in (0, 1))
    pd.testing.assert_frame_equal(first, once, check_exact=True)
    assert not np.isclose(first[XI], second[XI]).any()


@EVERY
def test_all_runs_of_a_noise_draw_use_the_subsample_of_its_first(kind, room_pair):
    values = {"subsampling_probability": 0.3, "noise_draws": 2, **KINDS[kind]}
    estimator = Estimator.of(kind, values).of_causes(NAMES)
    groups = perturb.groups(room_pair, [SPREAD], estimator, DEVIATION, STREAMS)
    for group in groups:
        (start,) = group.starts
        drawn = perturb.subsample(
            len(start.source), 0.3, STREAMS.generator(f"subsample/{group.runs[0]}")
        )
        (rows,) = start.rows
        np.testing.assert_array_equal(rows, drawn[start.usable[drawn]])
        assert len(start.T_initial) == len(group.runs)
        np.testing.assert_array_equal(start.initial_deviation, np.sqrt(2) * DEVIATION)


@EVERY
def test_without_links_every_sample_has_failed(kind, room_pair):
    found = runs(room_pair, [CLEAN], kind, maximum_distance=1e-12, **KINDS[kind])
    assert (found["status"] == "too_few_links").all()
    assert found["inlier_ratio"].eq(0).all() and found["rmse"].isna().all()


@EVERY
def test_without_points_every_sample_stays_and_has_failed(kind, room_pair):
    few = replace(room_pair, source=room_pair.source[:40], overlapping=room_pair.overlapping[:40])
    found = runs(few, [CLEAN], kind, **KINDS[kind])
    assert (found["status"] == "too_few_links").all()
    if kind != "bayesian":  # all states are of the first run's chain
        np.testing.assert_allclose(found[XI], found[INITIAL_XI], atol=1e-12)
    assert np.isfinite(found[TRANSFORM].to_numpy(float)).all()


@pytest.mark.parametrize("kind", ["stein", "stein_newton"])
def test_particles_that_coincide_are_degenerate(kind, room_pair):
    found = runs(room_pair, [CLEAN], kind, deviation=np.zeros(6), **KINDS[kind])
    assert (found["status"] == "degenerate").all()
    np.testing.assert_allclose(found[XI], 0, atol=1e-12)
