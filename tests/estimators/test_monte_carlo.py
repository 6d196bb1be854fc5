"""From a pair and settings to the table of runs."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from icpshap import icp, plan, se3
from icpshap.estimators import monte_carlo as estimators
from icpshap.estimators import perturb as perturbation
from icpshap.plan import Setting
from icpshap.tables import INITIAL_XI, TABLES, TRANSFORM, XI

LEVELS = {"sensor_noise": (0.05,), "initial_pose": (1.5,), "partial_overlap": (0.05,)}
SETTINGS = plan.settings(LEVELS, 1)
CLEAN, ALL_ON = Setting((0.0, 1.0, 0.0)), Setting((0.05, 1.5, 0.05))
STREAMS = perturbation.Streams(seed=1, sequence="room", reference=0, source=1)


@pytest.fixture(scope="module")
def registration(paper):
    return replace(
        paper.estimators["paper"].registration,
        runs=12,
        subsampling_probability=0.2,
        normal_neighbours=12,
    )


@pytest.fixture(scope="module")
def register(room_pair, registration, paper):
    def run(settings=SETTINGS, streams=STREAMS, **changes):
        return estimators.register_settings(
            room_pair, settings, replace(registration, **changes), paper.perturbation, streams
        )

    return run


@pytest.fixture(scope="module")
def runs(register):
    return register()


def of(runs, setting):
    on = (runs[["sensor_noise", "initial_pose", "partial_overlap"]] == list(setting.values)).all(
        axis=1
    )
    return runs[on & (runs["draws"] == int(setting.again))].reset_index(drop=True)


def test_every_setting_has_every_run_and_every_column(runs):
    assert len(runs) == 9 * 12
    assert set(runs.columns) == {column.name for column in TABLES["runs"]}
    for setting in SETTINGS:
        assert list(of(runs, setting)["run"]) == list(range(12))


def test_icp_finds_the_true_pose(runs):
    clean = of(runs, CLEAN)
    assert (clean["status"] == "ok").all()
    assert np.median(np.linalg.norm(clean[XI[3:]], axis=1)) < 0.02


def test_pose_errors_are_those_of_the_transforms(runs, room_pair):
    T = runs[TRANSFORM].to_numpy().reshape(-1, 4, 4)
    expected = se3.log(se3.inverse(room_pair.T_reference_source) @ T)
    np.testing.assert_allclose(runs[XI], expected, atol=1e-12)


def test_the_draws_are_common_to_all_settings(runs):
    clean, perturbed = of(runs, CLEAN), of(runs, Setting((0.0, 1.5, 0.0)))
    np.testing.assert_allclose(perturbed[INITIAL_XI], np.sqrt(1.5) * clean[INITIAL_XI])


def test_the_second_clean_sample_has_draws_of_its_own(runs):
    clean, again = of(runs, CLEAN), of(runs, replace(CLEAN, again=True))
    assert not np.isclose(clean[INITIAL_XI], again[INITIAL_XI]).any()


def test_a_result_does_not_depend_on_what_else_is_run(runs, register):
    alone = register([ALL_ON, CLEAN])
    for setting in (ALL_ON, CLEAN):
        pd.testing.assert_frame_equal(of(runs, setting), of(alone, setting), check_exact=True)


def test_a_run_does_not_depend_on_the_number_of_runs(runs, register):
    more = register([ALL_ON], runs=20)
    few = of(runs, ALL_ON).drop(columns="wrong_basin")
    pd.testing.assert_frame_equal(few, more.head(12).drop(columns="wrong_basin"), check_exact=True)


def test_one_run_taken_apart(register, runs, room_pair, registration):
    """The whole order of work for run 3 with everything on: perturb, range, subsample, register."""

    def normal(name, shape):
        return STREAMS.generator(name).standard_normal(shape)

    reference, source = (
        points + 0.05 * normal(f"noise/{role}/0", points.shape)
        for role, points in (("reference", room_pair.reference), ("source", room_pair.source))
    )
    order = STREAMS.generator("overlap").permutation(np.flatnonzero(room_pair.overlapping))
    removed = set(order[: round(0.05 * len(room_pair.reference))])
    drawn = perturbation.subsample(len(source), 0.2, STREAMS.generator("subsample/3"))
    rows = [r for r in drawn if r not in removed and np.linalg.norm(source[r]) > 1]
    deviation = np.repeat([np.deg2rad(10), 0.2], 3) / np.sqrt(3)
    xi = np.sqrt(1.5) * deviation * normal("initial_pose", (12, 6))[3]
    T_initial = room_pair.T_reference_source @ se3.exp(xi)
    far = np.linalg.norm(reference, axis=1) > 1
    result = icp.register(
        icp.Reference(reference[far], 12),
        source[np.array(rows)],
        [np.arange(len(rows))],
        T_initial[None],
        estimators.chain_of(registration),
    )
    run = of(runs, ALL_ON).iloc[3]
    np.testing.assert_allclose(
        run[TRANSFORM].to_numpy(float).reshape(4, 4), result.T_reference_source[0], atol=1e-12
    )
    assert run["iterations"] == result.iterations[0]


def test_noise_draws_share_the_runs_out_evenly(register):
    runs = register([CLEAN, ALL_ON], noise_draws=3)
    assert list(of(runs, ALL_ON)["noise_draw"]) == [0] * 4 + [1] * 4 + [2] * 4
    assert list(of(runs, ALL_ON)["run"]) == list(range(12))


def test_a_frozen_mask_makes_runs_from_one_pose_alike(register):
    tight = {"stop_rotation": 1e-7, "stop_translation": 1e-7, "kept_links": 1.0, "matches": 1}
    spread = {
        mask: register([CLEAN], subsampling_mask=mask, **tight)[XI].std().max()
        for mask in ("redrawn", "frozen", "frozen_in_order")
    }
    assert max(spread["frozen"], spread["frozen_in_order"]) < 0.1 * spread["redrawn"]


@pytest.mark.parametrize(("mask", "shifted"), [("frozen", False), ("frozen_in_order", True)])
def test_in_order_a_removed_point_shifts_the_rest(registration, room_pair, mask, shifted):
    sampler = estimators.Sampler(
        room_pair, replace(registration, subsampling_mask=mask), 0.2, STREAMS
    )
    every = np.ones(len(room_pair.source), dtype=bool)
    without = every.copy()
    without[100] = False
    (before,), (after,) = sampler.rows(every, [0]), sampler.rows(without, [0])
    np.testing.assert_array_equal(before[before < 100], after[after < 100])
    common = np.intersect1d(before, after)
    assert (len(common) < 0.7 * len(before)) == shifted


@pytest.mark.parametrize("kept", [{"subsampling_probability": 1.0}, {"subsampling_mask": "frozen"}])
def test_runs_with_the_same_subsample_share_its_rows(registration, room_pair, kept):
    """As many copies as runs would not fit into memory for the full scans of the data sets."""
    sampler = estimators.Sampler(room_pair, replace(registration, **kept), 0.2, STREAMS)
    rows = sampler.rows(np.arange(len(room_pair.source)) > 5, np.arange(100))
    assert len(rows) == 100
    assert all(run is rows[0] for run in rows)
    assert rows[0].min() > 5


def test_without_common_random_numbers_settings_draw_their_own(register):
    runs = register([CLEAN, Setting((0.0, 1.5, 0.0))], common_random_numbers=False)
    clean, perturbed = of(runs, CLEAN), of(runs, Setting((0.0, 1.5, 0.0)))
    assert not np.isclose(perturbed[INITIAL_XI], np.sqrt(1.5) * clean[INITIAL_XI]).any()


def test_replicates_draw_their_own(register):
    runs = register([CLEAN, replace(CLEAN, replicate=1)])
    first, second = (runs[runs["replicate"] == k].reset_index(drop=True) for k in (0, 1))
    assert not np.isclose(first[INITIAL_XI], second[INITIAL_XI]).any()


def test_the_released_codes_estimator_runs(register, paper):
    released = paper.estimators["released_code"].registration
    runs = register(
        [CLEAN, ALL_ON],
        **{
            key: getattr(released, key)
            for key in (
                "subsampling_mask",
                "initial_pose_scaling",
                "initial_pose_composition",
                "reference_noise_additions",
                "overlap_removal",
            )
        },
    )
    clean, on = of(runs, CLEAN), of(runs, ALL_ON)
    np.testing.assert_allclose(on[INITIAL_XI], 1.5 * clean[INITIAL_XI])
    assert (on["status"] == "ok").all()


def test_twice_added_noise_is_sqrt_two_larger(registration, room_pair):
    twice = replace(registration, reference_noise_additions=2)
    sampler = estimators.Sampler(room_pair, twice, 0.2, STREAMS)
    seen, measured, _ = sampler.noisy_clouds(0.05, 0)
    assert np.std(measured - room_pair.reference) == pytest.approx(0.05, rel=0.03)
    assert np.std(seen - room_pair.reference) == pytest.approx(0.05 * np.sqrt(2), rel=0.03)


def test_a_run_that_fails_stays_in_the_table_with_its_status(register):
    runs = register([CLEAN], maximum_distance=1e-9)
    assert len(runs) == 12
    assert (runs["status"] == "too_few_links").all()
    assert not runs["wrong_basin"].isna().any()


def test_a_failed_run_does_not_decide_which_basin_is_wrong(paper, registration, runs):
    table = of(runs, CLEAN)
    failed = table.index < 8
    table[XI] = np.where(failed[:, None], table[XI] + 5.0, table[XI])
    table["status"] = np.where(failed, "too_few_links", "ok")
    marked = estimators.mark_wrong_basins(table.drop(columns="wrong_basin"), registration)
    assert not marked["wrong_basin"].any()


def test_too_large_a_reduction_is_refused(registration, room_pair, paper):
    few = replace(room_pair, overlapping=np.arange(len(room_pair.source)) < 100)
    with pytest.raises(perturbation.PerturbationError, match="Hint: partial_overlap must be"):
        estimators.register_settings(few, [ALL_ON], registration, paper.perturbation, STREAMS)
