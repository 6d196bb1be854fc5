"""What a user gives of one pair: every mistake is named, with what was expected and what to do."""

from functools import partial

import numpy as np
import pytest

from icpshap import LIDAR, PAPER, RELEASED_CODE, se3
from icpshap.errors import DataError, UserError
from icpshap.one_pair.given import (
    CAUSES_GIVEN,
    given,
    named_pair,
    scan,
    times,
    transform,
    trials,
    whole,
)

T = se3.exp(np.array([0.1, -0.2, 0.3, 1.0, -2.0, 0.5]))
POINTS = np.random.default_rng(0).uniform(-5, 5, (1000, 3))


def own(reference, source, T_initial):
    return T_initial


def reflected():
    T_reflected = T.copy()
    T_reflected[:, 0] *= -1
    return T_reflected


def scaled():
    T_scaled = T.copy()
    T_scaled[:3, :3] *= 1000
    return T_scaled


class Registration:
    """A function that is an object."""

    def __call__(self, reference, source, T_initial):
        return T_initial


class Elsewhere:
    """What a tensor of another device does."""

    def __array__(self, dtype=None, copy=None):
        raise TypeError("cannot leave the device")


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (POINTS.astype(object), "type object, expected numbers"),
        ([["a", "b", "c"]], "expected numbers"),
        (POINTS[:, :2], r"shape (1000, 2), expected (n, 3)"),
        (POINTS.T, "points.T"),
        (np.hstack([POINTS, POINTS]), "points[:, :3]"),
        (np.ma.masked_array(POINTS, POINTS > 4), "entries are masked, expected none"),
        ([[1, 2, 3], [1, 2]], "no array of numbers"),
        (np.zeros(9, [("x", "f4"), ("y", "f4"), ("z", "f4")]), "np.stack([a[name] for name in"),
        (Elsewhere(), "no array of numbers (cannot leave the device)"),
        (POINTS[:999], "999 points, expected at least 1000"),
        (1e6 * POINTS, "expected at most 100000 m"),
        (np.where(np.arange(3000).reshape(-1, 3) == 7, np.nan, POINTS), "the first in row 2"),
    ],
)
def test_a_scan_that_is_none_is_refused(points, message):
    with pytest.raises(DataError) as error:
        scan(points, "reference")
    assert str(error.value).startswith("reference: ")
    assert message in str(error.value)
    assert "Hint: " in str(error.value)


@pytest.mark.parametrize("dtype", ["float32", "float64", "int32"])
def test_scans_are_float64_in_c_order_whatever_they_were(dtype):
    points = np.asfortranarray((100 * POINTS).astype(dtype))
    found = scan(points, "source")
    assert found.dtype == float
    assert found.flags.c_contiguous
    assert (found == points).all()


@pytest.mark.parametrize(
    "values", [T, T[:3], T.ravel(), T[:3].ravel(), T.tolist(), list(T[:3].ravel())]
)
def test_a_transform_has_several_forms(values):
    assert (transform(values) == T).all()


def test_seven_numbers_are_a_translation_and_a_quaternion():
    half = np.sqrt(0.5)
    found = transform([1, 2, 3, 0, 0, half, half])
    assert found[:3, 3].tolist() == [1, 2, 3]
    assert found[:3, :3] == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-12)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (reflected(), "a reflection"),
        (scaled(), "it has the scale 1000"),
        (T.T, "transpose it: "),
        (T + 0.1 * np.eye(4), "the last row of the matrix is [0.0, 0.0, 0.0, 1.1]"),
        (T[:3, :3], "shape (3, 3)"),
        (np.full((4, 4), np.nan), "not finite"),
        ("T.txt", "expected numbers"),
        (T + 0j, "type complex128, expected numbers"),
        ([[1], [1, 2]], "no array of numbers"),
        (np.ma.masked_array(T, np.eye(4)), "4 entries are masked"),
        ([1e9, 0, 0, 0, 0, 0, 1], "a translation of 1e+09"),
        ([1, 2, 3, 0, 0, 0, 0], "T: quaternion of norm 0, expected 1"),
        (np.zeros((4, 4)), "the last row of the matrix is"),
    ],
)
def test_a_transform_that_is_not_rigid_is_refused(values, message):
    with pytest.raises(DataError) as error:
        transform(values)
    assert str(error.value).startswith("T: ")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"causes": {"sensor_nois": 0.02}}, "causes: unknown cause 'sensor_nois', did you mean"),
        ({"causes": {"sensor_noise": -1}}, "causes.sensor_noise: -1"),
        ({"causes": {}}, "expected a level for each cause"),
        ({"causes": ["sensor_noise"]}, "causes: ['sensor_noise'], expected a mapping"),
        ({"causes": {"sensor_noise": 0, "initial_pose": 1}}, "causes: all are off"),
        ({"estimator": ["lidar"]}, "unknown preset or kind '['lidar']'"),
        ({"estimator": {"kind": "nope"}}, "unknown preset or kind 'nope'"),
        ({"estimator": {"based_on": ["x"]}}, "unknown preset or kind"),
        ({"estimator": "gicp", "register": own}, "the kind gicp, which registers itself"),
        ({"estimator": {"normal_neighbours": 9}, "register": own}, "'normal_neighbours' is an opt"),
        (
            {"estimator": {"kind": "callable", "register": own}, "register": own},
            "register: given twice, the estimator has own",
        ),
        ({"register": lambda reference, source: source}, "does not take three arguments"),
        ({"what_if": [("more", {"runs": 70})]}, "what_if: [('more', {'runs': 70})], expected"),
        ({"what_if": {"more": None}}, "what_if: more: None, expected a mapping"),
        ({"what_if": {"as it is": {"runs": 70}}}, "what_if: the name 'as it is'"),
        ({"what_if": {"": {"runs": 70}}}, "what_if: the name ''"),
        ({"what_if": {1: {"runs": 70}}}, "what_if: the name 1"),
        ({"what_if": {"more": {"based_on": "paper"}}}, "what_if: more: based_on"),
        ({"perturbation": 3}, "perturbation: 3, expected a mapping"),
        ({"seed": -1}, "seed: -1"),
        ({"seed": 1.5}, "seed: 1.5"),
        ({"seed": None}, "seed: None"),
        ({"seed": True}, "seed: True"),
        ({"estimator": "lidr"}, "unknown preset or kind 'lidr', did you mean 'lidar'?"),
        ({"estimator": {"normal_neighbors": 30}}, "did you mean 'normal_neighbours'?"),
        ({"estimator": {"runs": 10}}, "estimator.runs: 10 is less than the minimum of 50"),
        ({"estimator": {"noise_draws": 7}}, "estimator.noise_draws: 7"),
        ({"register": 3}, "register: of the type int, expected a function"),
        ({"register": "no_module:f"}, "there is no module no_module"),
        ({"what_if": {"more": {"runz": 3}}}, "what_if.more: unknown key 'runz'"),
        ({"what_if": {"more": {"range_bias": 0.1}}}, "what_if.more.range_bias: "),
        ({"causes": {"range_bias": 0.1}}, "expected at least 25"),
        ({"estimator": "learned"}, "learns from pairs of other sequences"),
        ({"perturbation": {"minimum_overlap": 2}}, "perturbation.minimum_overlap: 2"),
        ({"perturbation": {"overlap": 2}}, "perturbation: unknown key 'overlap'"),
    ],
)
def test_options_and_levels_are_checked_as_those_of_a_configuration(arguments, message):
    defaults = dict.fromkeys(("causes", "register", "what_if", "perturbation"))
    with pytest.raises(UserError) as error:
        given(**{**defaults, "estimator": "lidar", **arguments})
    assert message in str(error.value)
    assert "experiments." not in str(error.value)
    assert "change_" not in str(error.value)
    assert "Hint: " in str(error.value)


def test_what_is_given_is_what_is_run():
    found = given({"sensor_noise": "2e-2"}, {"based_on": "paper", "runs": 60}, None, None, None)
    assert found.levels == {"sensor_noise": 0.02}
    assert found.preset == PAPER.with_options(runs=60)
    assert found.what_if == {}


def test_a_preset_and_its_name_are_the_same():
    ways = ("paper", PAPER, {"based_on": "paper"}, {"kind": "monte_carlo"})
    found = [given(None, way, None, None, None).preset for way in ways]
    assert found == len(ways) * [PAPER]


def test_a_function_is_called_on_whole_clouds_with_what_the_estimator_says_else():
    def own(reference, source, T_initial):
        return T_initial

    found = given(None, "lidar", own, None, None).preset
    assert found.estimator.kind.function() is own
    assert found.estimator.perturbing.voxel_size is None
    assert found.estimator.perturbing.noise_draws == 10
    assert found.method.bias_correction == "jackknife"


def test_changes_are_named_or_the_usual_ones():
    found = given(None, "lidar", None, True, None).what_if
    assert set(found) == {"more_neighbours", "tight_stop", "more_points", "closer_start"}
    changes, levels, preset = found["closer_start"]
    assert changes == {"initial_pose": 1.0}
    assert levels == {**CAUSES_GIVEN, "initial_pose": 1.0}
    assert preset == given(None, "lidar", None, None, None).preset


def test_no_usual_change_takes_all_points():
    assert "more_points" in trials(PAPER.with_options(subsampling_probability=0.9), {})
    assert trials(PAPER, {})["twice_the_points"] == {"subsampling_probability": 0.1}
    assert not trials(PAPER.with_options(subsampling_probability=1.0), {}).keys() & {
        "more_points",
        "twice_the_points",
    }


def test_numpy_numbers_are_numbers_and_names_of_changes_are_free():
    found = given(
        {"sensor_noise": np.float32(0.5)},
        {"based_on": "paper", "runs": np.int64(60)},
        None,
        {"more neighbours": {"normal_neighbours": np.int64(30)}, "pair": {"runs": 70}},
        None,
        np.int64(7),
    )
    assert (found.levels, found.preset, found.seed) == (
        {"sensor_noise": 0.5},
        PAPER.with_options(runs=60),
        7,
    )
    assert [preset.options["runs"] for *_, preset in found.what_if.values()] == [60, 70]
    assert list(found.what_if) == ["more neighbours", "pair"]


@pytest.mark.parametrize(
    ("register", "name"),
    [(lambda a, b, c: c, "<lambda>"), (partial(own), "own"), (Registration(), "Registration")],
)
def test_any_function_is_taken_and_has_the_same_name_in_every_process(register, name):
    assert given(None, "lidar", register, None, None).name == name


def test_what_is_said_of_a_function_s_runs_counts():
    found = given(None, {"voxel_size": 0.5}, own, None, None).preset
    assert found.estimator.perturbing.voxel_size == 0.5


def test_a_closer_start_is_half_as_wide_whatever_its_scale_means():
    assert trials(PAPER, {"initial_pose": 6.0})["closer_start"] == {"initial_pose": 1.5}
    assert trials(RELEASED_CODE, {"initial_pose": 6.0})["closer_start"] == {"initial_pose": 3.0}


def test_a_closer_start_is_never_closer_than_that_of_the_clean_setting():
    assert trials(LIDAR, CAUSES_GIVEN)["closer_start"] == {"initial_pose": 1.0}
    for levels in ({"initial_pose": 2.0}, {**CAUSES_GIVEN, "initial_pose": 0.5}, {}):
        assert "closer_start" not in trials(LIDAR, levels)


def test_a_mapping_begins_from_lidar_or_from_the_defaults_of_its_kind():
    def options(estimator):
        return given(None, estimator, None, None, None).preset.options

    assert options({}) == options("lidar") == LIDAR.options
    assert options({"kind": "monte_carlo"}) == options("monte_carlo") == PAPER.options
    assert options({"kind": "monte_carlo", "based_on": "lidar"}) == LIDAR.options


@pytest.mark.parametrize("value", [0, -1, "2", 1.5, True, [1]])
def test_a_number_of_threads_is_whole_and_positive(value):
    with pytest.raises(UserError, match=r"threads: .*expected a whole number of at least 1"):
        whole(value, "threads", 1)


@pytest.mark.parametrize(
    ("name", "indices", "message"),
    [
        (3, (0, 1), "name: 3"),
        ("pair", (0,), "indices: "),
        ("pair", "01", "indices: "),
        ("pair", (0, 0.5), "indices: 0.5"),
        ("pair", (-1, 0), "indices: -1"),
    ],
)
def test_what_random_numbers_are_drawn_for_is_checked(name, indices, message):
    with pytest.raises(UserError, match=message):
        named_pair(name, indices)


@pytest.mark.parametrize(
    "values",
    [[1.0], np.zeros(10), np.full(10, np.nan), "x", np.arange(10) + 0j, np.arange(10)[:, None]],
)
def test_times_that_are_none_are_refused(values):
    with pytest.raises(DataError, match="source_times"):
        times(values, 10)
