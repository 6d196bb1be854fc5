"""From a pair and settings to the table of runs."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from icpshap import causes, estimators, icp, plan, se3
from icpshap.errors import PerturbationError
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Perturbation, Streams, subsample
from icpshap.plan import Setting
from icpshap.presets import RELEASED_CODE
from icpshap.tables import INITIAL_XI, TRANSFORM, XI, columns

LEVELS = {"sensor_noise": (0.05,), "initial_pose": (1.5,), "partial_overlap": (0.05,)}
SETTINGS = plan.settings(LEVELS, 1)
CLEAN = Setting.at({"sensor_noise": 0.0, "initial_pose": 1.0, "partial_overlap": 0.0})
ALL_ON = Setting.at({name: level for name, (level,) in LEVELS.items()})
POSE_ON = Setting.at({**CLEAN.values, "initial_pose": 1.5})
STREAMS = Streams(seed=1, sequence="room", reference=0, source=1)
OPTIONS = {"runs": 12, "subsampling_probability": 0.2, "normal_neighbours": 12}
DEVIATION = Perturbation().deviation


def estimator(**changes):
    return Estimator.of("monte_carlo", {**OPTIONS, **changes}).of_causes(LEVELS)


@pytest.fixture(scope="module")
def register(room_pair):
    def run(settings=SETTINGS, streams=STREAMS, **changes):
        given = (settings, estimator(**changes), DEVIATION, streams)
        runs, estimates = estimators.estimate(room_pair, *given)
        assert estimates is None
        return runs

    return run


@pytest.fixture(scope="module")
def runs(register):
    return register()


def of(runs, setting):
    on = (runs[list(setting.values)] == list(setting.values.values())).all(axis=1)
    return runs[on & (runs["again"] == setting.again)].reset_index(drop=True)


def test_every_setting_has_every_run_and_every_column(runs):
    assert len(runs) == 9 * 12
    known = {column.name for column in columns("runs", causes.named(LEVELS))}
    assert {*runs.columns, "reference", "source"} == known
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
    clean, perturbed = of(runs, CLEAN), of(runs, POSE_ON)
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
    few = of(runs, ALL_ON)
    pd.testing.assert_frame_equal(few, more.head(12), check_exact=True)


def test_one_run_taken_apart(runs, room_pair):
    """The whole order of work for run 3 with everything on: perturb, range, subsample, register."""

    def normal(name, shape):
        return STREAMS.generator(name).standard_normal(shape)

    reference, source = (
        points + 0.05 * normal(f"noise/{role}/0", points.shape)
        for role, points in (("reference", room_pair.reference), ("source", room_pair.source))
    )
    order = STREAMS.generator("overlap").permutation(np.flatnonzero(room_pair.overlapping))
    removed = set(order[: round(0.05 * len(room_pair.reference))])
    drawn = subsample(len(source), 0.2, STREAMS.generator("subsample/3"))
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
        estimator().kind.chain(),
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


def test_without_common_random_numbers_settings_draw_their_own(register):
    runs = register([CLEAN, POSE_ON], common_random_numbers=False)
    clean, perturbed = of(runs, CLEAN), of(runs, POSE_ON)
    assert not np.isclose(perturbed[INITIAL_XI], np.sqrt(1.5) * clean[INITIAL_XI]).any()


def test_replicates_draw_their_own(register):
    runs = register([CLEAN, replace(CLEAN, replicate=1)])
    first, second = (runs[runs["replicate"] == k].reset_index(drop=True) for k in (0, 1))
    assert not np.isclose(first[INITIAL_XI], second[INITIAL_XI]).any()


def test_the_released_codes_estimator_runs(register):
    released = RELEASED_CODE.options
    runs = register(
        [CLEAN, ALL_ON],
        **{
            key: released[key]
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


def test_a_run_that_fails_stays_in_the_table_with_its_status(register):
    runs = register([CLEAN], maximum_distance=1e-9)
    assert len(runs) == 12
    assert (runs["status"] == "too_few_links").all()
    assert runs["weight"].eq(1).all()


def test_too_large_a_reduction_is_refused(room_pair):
    few = replace(room_pair, overlapping=np.arange(len(room_pair.source)) < 100)
    with pytest.raises(PerturbationError, match="Hint: partial_overlap must be"):
        estimators.estimate(few, [ALL_ON], estimator(), DEVIATION, STREAMS)


@pytest.mark.parametrize(("mask", "expected"), [("redrawn", list(range(12))), ("frozen", [0] * 12)])
def test_runs_of_one_subsample_may_be_matched_together(register, monkeypatch, mask, expected):
    """Those of all settings of a noise level, also where some have removed points."""
    given = []
    registered = icp.register

    def noted(reference, source, rows, T_initial, chain, packets=None):
        given.append((rows, packets))
        return registered(reference, source, rows, T_initial, chain, packets)

    monkeypatch.setattr(icp, "register", noted)
    removed = Setting.at({**CLEAN.values, "partial_overlap": 0.05})
    register([CLEAN, POSE_ON, removed], subsampling_mask=mask)
    ((rows, packets),) = given
    first = [packets.index(packet) for packet in packets]
    assert first == expected * 3
    for run, packet in zip(rows, first, strict=True):
        assert np.isin(run, rows[packet]).all()  # of the clean setting, with all points
