"""The configuration: what it says, and what it is told when it is wrong."""

import re
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest
import yaml
from conftest import REPOSITORY
from snakemake.utils import update_config

from icpshap import config as configuration
from icpshap import options, plan, presets, schema
from icpshap.causes import CAUSES, Cause
from icpshap.estimators import KINDS
from icpshap.estimators.kind import COVARIANCES, Kind
from icpshap.explanation.sample import FEWEST_RUNS
from icpshap.options import option
from icpshap.presets import LIDAR, PAPER, RELEASED_CODE, ROBUST, Preset

NAMES = ("sensor_noise", "initial_pose", "partial_overlap")


def errors_of(config):
    with pytest.raises(configuration.ConfigError) as caught:
        configuration.load(config)
    return str(caught.value)


def change(config, path, value):
    *parents, key = path.split(".")
    block = config
    for parent in parents:
        block = block[parent]
    if value is None:
        del block[key]
    else:
        block[key] = value


def test_the_paper_is_the_default(paper):
    grid = paper.experiments["different_perturbations"]
    assert grid.pairs == {"apartment": ((6, 7),)}
    assert [len(grid.levels[name]) for name in NAMES] == [11, 11, 11]
    assert len(plan.instances(grid.levels)) == 1331
    clean_twice = 1
    assert len(plan.settings(grid.levels, 1)) == 1331 + clean_twice
    assert grid.causes == NAMES
    assert [tuple(couple) for couple in grid.dependence] == list(configuration.PAPER_COUPLES)
    assert paper.experiments["same_perturbation"].levels == {
        "sensor_noise": (0.05,),
        "initial_pose": (1.5,),
        "partial_overlap": (0.05,),
    }
    assert sum(len(pairs) for pairs in paper.experiments["same_perturbation"].pairs.values()) == 267
    assert paper.estimators == {
        "paper": PAPER,
        "released_code": RELEASED_CODE,
        "robust": ROBUST,
        "lidar": LIDAR,
    }


OVERRIDES = ("all_causes", "demo", "estimators", "here", "released_code", "robust")


@pytest.mark.parametrize("name", OVERRIDES)
def test_every_shipped_override_loads(config, name):
    update_config(config, yaml.safe_load((REPOSITORY / f"config/{name}.yaml").read_text()))
    loaded = configuration.load(config)
    assert all(experiment in loaded.experiments for experiment in loaded.run)


def test_levels_are_rounded_and_include_the_stop():
    levels = configuration.expand_levels({"start": 0, "stop": 0.1, "step": 0.01})
    assert levels == (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1)
    assert configuration.expand_levels({"start": 1, "stop": 1.25, "step": 0.1}) == (1.0, 1.1, 1.2)


def test_strings_of_the_command_line_become_what_the_schema_wants(config):
    config["seed"] = "7"
    config["estimators"]["paper"] |= {
        "stop_rotation": "1e-3",
        "maximum_distance": "null",
        "common_random_numbers": "false",
        "runs": "50",
    }
    loaded = configuration.load(config)
    paper = loaded.estimators["paper"].options
    assert (loaded.seed, paper["stop_rotation"], paper["runs"]) == (7, 1e-3, 50)
    assert paper["maximum_distance"] is None
    assert paper["common_random_numbers"] is False


@pytest.mark.parametrize("runs", ["1e2", 100.0, "100.0", "100"])
def test_an_integer_may_be_written_as_a_float(config, runs):
    config["estimators"]["paper"]["runs"] = runs
    loaded = configuration.load(config).estimators["paper"].options["runs"]
    assert (loaded, type(loaded)) == (100, int)


def test_a_large_integer_loses_no_digit_on_the_command_line(config):
    config["seed"] = "9007199254740993"
    assert configuration.load(config).seed == 9007199254740993


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan"), "inf", "NaN"])
@pytest.mark.parametrize(
    "path",
    [
        "seed",
        "perturbation.overlap_distance",
        "estimators.paper.maximum_distance",
        "experiments.different_perturbations.instances.grid.sensor_noise.stop",
        "experiments.same_perturbation.instances.fixed.initial_pose",
    ],
)
def test_numbers_must_be_finite(config, path, value):
    change(config, path, value)
    message = errors_of(config)
    assert "1 error(s)" in message
    assert f"{path}: expected a finite number, found {float(value)}. Hint: " in message


def test_an_infinite_level_of_a_list_is_named(config):
    path = "experiments.different_perturbations.instances.grid.sensor_noise"
    change(config, path, [0, float("inf")])
    assert f"{path}.1: expected a finite number, found inf" in errors_of(config)


def test_the_fewest_runs_are_those_that_give_a_value():
    runs = schema.estimator("monte_carlo")["properties"]["runs"]
    assert runs["minimum"] == FEWEST_RUNS
    assert f"fewer than {FEWEST_RUNS}" in runs["description"]


def test_an_estimator_takes_what_it_does_not_give(config):
    config["estimators"]["mine"] = {"based_on": "robust", "runs": 200}
    assert configuration.load(config).estimators["mine"] == ROBUST.with_options(runs=200)


def test_what_an_estimator_does_not_give_is_as_in_the_paper(config):
    config["estimators"]["mine"] = {"runs": 200}
    assert configuration.load(config).estimators["mine"] == PAPER.with_options(runs=200)


def test_all_errors_at_once(config):
    config["sequnces"] = ["eth"]
    config["run"] = ["same_pertubation"]
    config["estimators"]["paper"]["runz"] = 100
    config["estimators"]["robust"]["runs"] = "many"
    message = errors_of(config)
    assert "4 error(s)" in message
    assert "unknown key 'sequnces', did you mean 'sequences'?" in message
    assert "run: unknown name 'same_pertubation', did you mean 'same_perturbation'?" in message
    assert "estimators.paper: unknown key 'runz', did you mean 'runs'?" in message
    assert "estimators.robust.runs: 'many' is not of type 'integer'" in message
    assert "Hint:" in message


def test_of_a_value_of_another_type_the_names_are_said_alone(config):
    change(config, "data.mine", {"scans": 2, "simulated": {"scene": [3]}})
    message = errors_of(config)
    assert "simulated.scene: unknown name '[3]', expected one of apartment, corridor" in message
    assert "is not of type" not in message


ONE_VALUE = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}


# Change at a path of the configuration (None removes the key), and what the error must say.
MISTAKES = [
    ("sequences", ["stair"], "unknown name 'stair', did you mean 'stairs'? Hint: define it under"),
    ("run", ["mine"], "different_perturbations, same_perturbation. Hint: define it under experim"),
    (
        "sequences",
        "stairs",
        "expected a list, found 'stairs'. Hint: --config 'sequences=[stairs]'",
    ),
    (
        "experiments.same_perturbation.sequences",
        "eth",
        "found 'eth'. Hint: --config 'experiments={same_perturbation: {sequences: [eth]}}'",
    ),
    (
        "experiments.different_perturbations.instances.grid.sensor_noise",
        0.05,
        "expected a list, found 0.05. Hint: --config 'experiments={different_perturbations: "
        "{instances: {grid: {sensor_noise: [0.05]}}}}'",
    ),
    (
        "experiments.same_perturbation.pairs",
        3,
        "pairs: 3 is none of what it may be (consecutive: scans i and i+1 of every sequence",
    ),
    (
        "experiments.same_perturbation.pairs",
        [3],
        "pairs.0: 3 is not of type 'object' (sequence: .., reference: .., source: ..)",
    ),
    ("run", 3, "run: 3 is not of type 'array'"),
    ("seed", "x", "seed: 'x' is not of type 'integer'"),
    ("seed", -1, "seed: -1 is less than the minimum of 0"),
    ("data.eth.scans", 1, "data.eth.scans: 1 is less than the minimum of 2"),
    ("data.eth.folder", {"path": "x"}, "data.eth: expected exactly one of archive, folder, simu"),
    ("data.eth.archive", None, "data.eth: expected exactly one of archive, folder, simulated, fo"),
    ("data.eth.archive", {"bytes": 3}, "data.eth.archive: expected url, or path for a ZIP on disk"),
    *(
        ("data.own", {"scans": 3, **block}, f"data.own.folder.{said}")
        for block, said in (
            (
                {"folder": {"path": "x", "columns": ["x", "y", "r"]}},
                "columns: no z among x, y, r, expected x, y and z",
            ),
            (
                {"folder": {"path": "x", "columns": ["x", "y", "z"]}, "time": "t"},
                "columns: no t, which is the `time` of the sequence",
            ),
            (
                {"folder": {"path": "x", "files": ["a.ply", "b.ply"]}},
                "files: 2 files, expected as many as `scans: 3`",
            ),
            (
                {"folder": {"path": "x", "guess": "guess.txt"}},
                "guess: expected with `poses: register` alone",
            ),
            (
                {"folder": {"path": "x", "poses": "register", "guess": [0] * 13}},
                "guess: 13 numbers, expected 12 or 16",
            ),
            (
                {"folder": {"path": "x", "poses": "register", "quaternion": "wxyz"}},
                "quaternion: expected with a pose file alone",
            ),
            ({"folder": {"path": "x", "quaternion": "xywz"}}, "quaternion: unknown name 'xywz'"),
        )
    ),
    ("data.eth.archive.url", "ftp://x", "data.eth.archive.url: 'ftp://x' does not match"),
    ("data.Eth", {"scans": 3}, "'Eth' does not match"),
    ("estimators.paper.metric", "point_to_plan", "did you mean 'point_to_plane'?"),
    ("estimators.paper.kept_links", 0, "0 is less than or equal to the minimum of 0"),
    (
        "estimators.paper.kind",
        "monte_carl",
        "unknown name 'monte_carl', did you mean 'monte_carlo'?",
    ),
    ("estimators.robust.based_on", "papr", "unknown name 'papr', did you mean 'paper'?"),
    ("estimators.paper.based_on", "robust", "circle"),
    ("estimators.paper.bias_correction", "wishart", "holds for independent samples only"),
    ("estimators.robust.noise_draws", 7, "noise_draws: 7 does not divide runs: 100"),
    ("experiments.same_perturbation.estimator", "papr", "unknown name 'papr'"),
    ("experiments.same_perturbation.estimator", None, "missing estimator"),
    ("experiments.same_perturbation.sequences", None, "`pairs: consecutive` needs it"),
    ("experiments.same_perturbation.sequences", ["et"], "unknown name 'et', did you mean 'eth'?"),
    ("experiments.different_perturbations.sequences", ["eth"], "names its own sequences"),
    (
        "experiments.different_perturbations.pairs",
        [{"sequence": "apartment", "reference": 44, "source": 45}],
        "source 45 of apartment does not exist, expected 0 to 44",
    ),
    (
        "experiments.different_perturbations.pairs",
        [{"sequence": "apartment", "refrence": 1, "source": 2}],
        "pairs.0: unknown key 'refrence', did you mean 'reference'?",
    ),
    (
        "experiments.different_perturbations.pairs",
        [{"sequence": "apartment", "reference": 3, "source": 3}],
        "reference and source are both scan 3",
    ),
    ("experiments.different_perturbations.waterfall", None, "asks for a waterfall plot"),
    (
        "experiments.different_perturbations.waterfall.initial_pose",
        1.15,
        "1.15 is not a level of the grid. Hint: its levels are 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6",
    ),
    (
        "experiments.different_perturbations.instances.fixed",
        ONE_VALUE,
        "instances: expected one of grid, fixed, here, found grid and "
        "fixed. Hint: mappings of several config",
    ),
    (
        "experiments.comparison",
        {"based_on": "same_perturbation"},
        "results has a folder comparison",
    ),
    ("data.figures", {"scans": 2, "folder": {"path": "x"}}, "data.figures: the name is taken"),
    ("data.tables", {"scans": 2, "folder": {"path": "x"}}, "data.tables: the name is taken"),
    (
        "data.apartment",
        {"scans": 2, "archive": None, "simulated": {"scene": "plain", "beams": 400_000}},
        "simulated.beams: 400000, expected at most 367540",
    ),
    (
        "data.apartment",
        {"scans": 2, "archive": None, "simulated": {"scene": "plain", "beams": 4000, "speed": 1}},
        "simulated.speed: the tilting laser stands while it scans",
    ),
    (
        "estimators.released_code.voxel_size",
        0.2,
        "released_code.voxel_size: the grid keeps points of the raw scans, which partial_overlap",
    ),
    (
        "experiments.same_perturbation.what_if",
        {"more": {"normal_neighbors": 20}},
        "experiments.same_perturbation.what_if.more: unknown key 'normal_neighbors', did you mean "
        "'normal_neighbours'?",
    ),
    (
        "experiments.same_perturbation.what_if",
        {"more": {"normal_neighbours": 99}},
        "experiments.same_perturbation.what_if.more.normal_neighbours: 99 is greater than",
    ),
    (
        "experiments.same_perturbation.what_if",
        {"closer": {"initial_pose": -1}},
        "experiments.same_perturbation.what_if.closer.initial_pose: -1 is less than or equal to",
    ),
    (
        "experiments.same_perturbation.what_if",
        {"biased": {"range_bias": 0.1}},
        "what_if.biased.range_bias: the experiment does not name this cause",
    ),
    (
        "experiments.same_perturbation.what_if",
        {"own": {"sensor_sigma": 0.01}},
        "experiments.same_perturbation.what_if.own.noise_draws: 1, expected at least 10",
    ),
    ("experiments.same_perturbation.what_if", {"none": {}}, "what_if.none"),
    ("experiments.same_perturbation.what_if", {"More": {"runs": 50}}, "More"),
    ("estimators.paper.runs", 49, "runs: 49 is less than the minimum of 50"),
    ("estimators.paper.runs", "1e-2", "runs: 0.01 is not of type 'integer'"),
    (
        "experiments.different_perturbations.instances.grid.sensor_noise",
        [-0.01],
        "-0.01 is less than the minimum of 0",
    ),
    (
        "experiments.different_perturbations.instances.grid.initial_pose",
        [0, 1],
        "initial_pose.0: 0 is less than or equal to the minimum of 0",
    ),
    (
        "experiments.different_perturbations.instances.grid.partial_overlap",
        [0, 1.5],
        "partial_overlap.1: 1.5 is greater than the maximum of 1",
    ),
    (
        "experiments.different_perturbations.instances.grid.sensor_noise.stop",
        -0.1,
        "-0.1 is less than the minimum of 0",
    ),
    (
        "experiments.same_perturbation.instances.fixed.sensor_noise",
        -0.05,
        "-0.05 is less than the minimum of 0",
    ),
]


@pytest.mark.parametrize(
    ("path", "value", "message"), MISTAKES, ids=[f"{m[0]}={m[1]}"[:70] for m in MISTAKES]
)
def test_every_mistake_is_named(config, path, value, message):
    change(config, path, value)
    assert message in errors_of(config)


def test_every_key_of_the_schema_is_described_and_every_block_closed():
    def walk(schema, where):
        for key, child in schema.get("properties", {}).items():
            assert child.get("description"), f"{where}.{key} has no description"
            walk(child, f"{where}.{key}")
        if schema.get("type") in ("object", ["object", "null"]):
            assert "additionalProperties" in schema, f"{where} is open"
        for branch in (*schema.get("oneOf", []), schema.get("additionalProperties")):
            if isinstance(branch, dict):
                walk(branch, where)

    walk(schema.configuration(), "config")


def test_every_key_of_the_estimator_has_a_comment_in_the_config():
    text = (REPOSITORY / "config.yaml").read_text()
    block = text[text.index("  paper:") : text.index("  released_code:")]
    keys = re.findall(r"^    (\w+):", block, flags=re.MULTILINE)
    assert sorted(keys) == sorted(["kind", *presets.option_names("monte_carlo")])
    assert sorted(schema.estimator("monte_carlo")["properties"]) == sorted([*keys, "based_on"])


def test_the_presets_are_those_of_config_yaml(paper):
    """And `with_options` of nothing is the same preset again."""
    for preset in (PAPER, RELEASED_CODE, ROBUST, LIDAR):
        assert preset.with_options() == preset
    with pytest.raises(TypeError, match="runz: no options of the kind monte_carlo"):
        PAPER.with_options(runz=3)


# --- causes: not named is off ---------------------------------------------------------------------


@dataclass(frozen=True)
class Extra(Cause):
    """A cause that the repository does not have."""

    name: ClassVar = "extra"
    title: ClassVar = "extra"
    symbol: ClassVar = "e"
    meaning: ClassVar = "Extra"
    colour: ClassVar = "#123456"
    levels: ClassVar = (1.0, 2.0)
    range: ClassVar = options.Range(minimum=0, below=10)

    def move(self, points, scan, level, draw, streams):
        return points + level


def with_extras(monkeypatch, number):
    names = [f"extra_{k}" for k in range(number)]
    for name in names:
        monkeypatch.setitem(CAUSES, name, type(name, (Extra,), {"name": name}))
    return names


def test_players_are_the_causes_that_an_experiment_names(config):
    grid = config["experiments"]["different_perturbations"]
    grid["instances"] = {"grid": {"partial_overlap": [0, 0.1], "sensor_noise": [0, 0.05]}}
    grid["waterfall"] = {"partial_overlap": 0.1, "sensor_noise": 0.05}
    del grid["dependence"]
    found = configuration.load(config).experiments["different_perturbations"]
    assert found.causes == ("sensor_noise", "partial_overlap")
    assert list(found.waterfall) == list(found.causes)
    assert found.dependence == ()


def test_a_new_cause_makes_no_configuration_invalid_and_changes_none(config, monkeypatch):
    before = configuration.load(config)
    with_extras(monkeypatch, 1)
    after = configuration.load(config)
    assert before.experiments == after.experiments
    of_paper = after.estimators["paper"].estimator.of_causes(NAMES)
    assert of_paper.decides() == before.estimators["paper"].estimator.of_causes(NAMES).decides()


def test_a_new_cause_can_be_named_at_once(config, monkeypatch):
    (name,) = with_extras(monkeypatch, 1)
    fixed = config["experiments"]["same_perturbation"]["instances"]["fixed"]
    fixed[name] = 3
    experiment = configuration.load(config).experiments["same_perturbation"]
    assert experiment.levels[name] == (3.0,)
    fixed[name] = 10
    assert f"fixed.{name}: 10 is greater than or equal to the maximum of 10" in errors_of(config)


def test_seven_causes_are_enough(config, monkeypatch):
    names = with_extras(monkeypatch, 5)
    fixed = config["experiments"]["same_perturbation"]["instances"]["fixed"]
    fixed |= dict.fromkeys(names[:4], 1)
    assert len(configuration.load(config).experiments["same_perturbation"].causes) == 7
    fixed[names[4]] = 1
    message = errors_of(config)
    assert (
        "same_perturbation.instances.fixed: 8 causes, expected at most 7: an instance of M causes "
        "is 2^M settings, here 256, and each is run. Hint: leave out causes" in message
    )


SAME = "experiments.same_perturbation"
GRID = "experiments.different_perturbations"

# Of causes, estimators and couples.
MORE_MISTAKES = [
    ("estimators.paper.kind", ["monte_carlo"], "estimators.paper.kind"),
    ("estimators.released_code.based_on", ["paper"], "estimators.released_code.based_on"),
    ("sequences", [["apartment"]], "sequences"),
    ("run", [{"a": 1}], "run"),
    ("data.apartment.time", "x", "data.apartment.time: x is a coordinate, expected the column"),
    (
        f"{SAME}.instances.fixed.sensor_nois",
        0.1,
        f"{SAME}.instances.fixed: unknown cause 'sensor_nois', did you mean 'sensor_noise'?",
    ),
    (
        f"{GRID}.instances.grid.sensor_nois",
        [0.1],
        f"{GRID}.instances.grid: unknown cause 'sensor_nois', did you mean 'sensor_noise'?",
    ),
    (
        f"{GRID}.waterfall.partial_overlap",
        None,
        f"{GRID}.waterfall: missing partial_overlap; the instance needs a value of each cause",
    ),
    (
        f"{GRID}.instances.grid.partial_overlap",
        None,
        f"{GRID}.waterfall.partial_overlap: instances.grid does not name this cause, so it is off.",
    ),
    (
        f"{GRID}.dependence",
        [["sensor_noise", "partial_overla"]],
        "unknown name 'partial_overla', did you mean 'partial_overlap'?",
    ),
    (f"{GRID}.dependence", [["sensor_noise", "sensor_noise"]], "has non-unique elements"),
    (
        f"{SAME}.dependence",
        [["sensor_noise", "partial_overlap"], ["sensor_noise", "initial_pose", "partial_overlap"]],
        "is too long",
    ),
    ("estimators.paper.covariance", 1, "estimators.paper: unknown key 'covariance'"),
]


@pytest.mark.parametrize(
    ("path", "value", "message"), MORE_MISTAKES, ids=[f"{m[0]}={m[1]}"[:70] for m in MORE_MISTAKES]
)
def test_mistakes_of_causes_and_couples_are_named(config, path, value, message):
    change(config, path, value)
    assert message in errors_of(config)


def test_a_couple_of_a_cause_that_is_not_named(config):
    del config["experiments"]["different_perturbations"]["instances"]["grid"]["partial_overlap"]
    message = errors_of(config)
    assert "dependence: unknown cause of the experiment 'partial_overlap'" in message
    assert "Hint: name it under instances" in message


def test_a_key_that_is_there_twice_is_an_error(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "experiments:\n  a:\n    instances:\n      fixed: {sensor_noise: 1, sensor_noise: 2}\n"
    )
    with pytest.raises(configuration.ConfigError) as caught:
        configuration.check_file(path)
    message = str(caught.value)
    assert "mine.yaml: 1 key(s) are given twice" in message
    assert "line 4: experiments.a.instances.fixed.sensor_noise is there twice" in message
    assert "Hint: keep one of each" in message
    for name in ("config.yaml", "config/demo.yaml", "tests/tiny.yaml"):
        configuration.check_file(REPOSITORY / name)


# --- estimators: a kind and its own options -------------------------------------------------------


@dataclass(frozen=True)
class Constant(Kind):
    """A kind that the repository does not have."""

    name: ClassVar = "constant"
    returns: ClassVar = COVARIANCES
    sees: ClassVar = ("sensor_noise", "initial_pose")
    deviation: float = option(0.1, "The same in every direction", unit="-", above=0)


@pytest.fixture
def constant(config, monkeypatch):
    monkeypatch.setitem(KINDS, "constant", Constant)
    config["estimators"]["mine"] = {"kind": "constant", "deviation": 0.3}
    return config


def test_an_estimator_of_a_kind_has_the_options_of_the_kind(constant):
    found = configuration.load(constant).estimators["mine"]
    assert found == Preset.of("constant", deviation=0.3)
    assert found.estimator.kind == Constant(deviation=0.3)
    assert "matches" not in found.options


def test_an_option_of_another_kind_is_named_with_its_kind(constant):
    constant["estimators"]["mine"] |= {"runs": 60, "links": "shared"}
    constant["estimators"]["paper"]["deviation"] = 0.1
    message = errors_of(constant)
    assert (
        "estimators.mine: 'links' is an option of the kinds closed_form, unscented, and" in message
    )
    assert (
        "estimators.mine: 'runs' is an option of the kinds callable, monte_carlo, and this "
        "estimator is of the kind constant. Hint: leave it out, or change `kind`" in message
    )
    assert "estimators.paper: 'deviation' is an option of the kind constant" in message


def test_an_option_of_a_kind_has_its_range(constant):
    constant["estimators"]["mine"]["deviation"] = 0
    assert "estimators.mine.deviation: 0 is less than or equal to the minimum of 0" in errors_of(
        constant
    )


def test_an_estimator_is_not_based_on_one_of_another_kind(constant):
    constant["estimators"]["mine"]["based_on"] = "paper"
    message = errors_of(constant)
    assert (
        "of `based_on: paper` are no options of the kind constant. Hint: leave based_on" in message
    )
    assert "runs" in message


@pytest.mark.parametrize(
    ("correction", "says"),
    [
        (
            "wishart",
            "wishart holds for independent samples, which the kind constant does not return",
        ),
        ("jackknife", "jackknife leaves out independent runs, which the kind constant does not"),
    ],
)
def test_a_correction_needs_what_the_kind_returns(constant, correction, says):
    constant["estimators"]["mine"]["bias_correction"] = correction
    assert f"estimators.mine.bias_correction: {says}" in errors_of(constant)


def test_several_noise_draws_can_be_left_out(constant):
    constant["estimators"]["mine"] |= {"bias_correction": "jackknife", "noise_draws": 3}
    configuration.load(constant)


# --- an estimator that learns from another experiment ---------------------------------------------


@pytest.fixture
def learning(config):
    """The paper's second experiment, and the same by an estimator that learns from it."""
    config["estimators"]["mine"] = {"kind": "learned"}
    config["experiments"]["again"] = {"based_on": "same_perturbation", "estimator": "mine"}
    config["run"] = ["same_perturbation", "again"]
    return config


def test_an_estimator_learns_from_a_selected_experiment(learning):
    assert configuration.load(learning).estimators["mine"].estimator.kind.training == (
        "same_perturbation"
    )


def test_an_experiment_that_is_not_run_may_learn_from_one_that_is_not(learning):
    learning["run"] = ["different_perturbations"]
    learning["sequences"] = ["apartment"]
    configuration.load(learning)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"estimators.mine.training": "same_perturbatoin"},
            "unknown name 'same_perturbatoin', did you mean 'same_perturbation'? Hint: define it",
        ),
        (
            {"estimators.mine.training": "again"},
            "the estimator mine of again is of the kind learned, which returns no pose samples to "
            "learn from. Hint: name an experiment whose estimator is of the kind monte_carlo",
        ),
        (
            {"run": ["again"]},
            "again learns from same_perturbation, which is not selected. "
            "Hint: run: [again, same_perturbation]",
        ),
        (
            {"sequences": ["apartment", "eth", "stairs", "mountain", "gazebo_summer"]},
            "again learns from all sequences of same_perturbation, of which gazebo_winter, "
            "wood_summer, wood_autumn are not selected. Hint: select them",
        ),
        (
            {"experiments.same_perturbation.sequences": ["apartment", "eth"], "data.eth.scans": 30},
            "for apartment of again, same_perturbation has 29 pairs of other sequences to learn "
            "from, expected at least 30. Hint: more sequences",
        ),
    ],
)
def test_what_is_wrong_with_what_it_learns_from(learning, changes, says):
    for path, value in changes.items():
        change(learning, path, value)
    assert f"estimators.mine.training: {says}" in errors_of(learning)


def test_a_cause_that_the_kind_cannot_see_is_refused(constant):
    constant["experiments"]["same_perturbation"]["estimator"] = "mine"
    assert (
        "experiments.same_perturbation.estimator: the kind constant cannot see partial_overlap. "
        "Hint: name only sensor_noise, initial_pose, or another estimator" in errors_of(constant)
    )


def test_masks_do_not_go_with_the_released_codes_overlap(config, monkeypatch):
    name = "shadow"
    keep = {"name": name, "move": Cause.move, "keep": lambda *given: None}
    monkeypatch.setitem(CAUSES, name, type("Shadow", (Extra,), keep))
    experiment = config["experiments"]["same_perturbation"]
    experiment["instances"]["fixed"][name] = 1
    configuration.load(config)
    experiment["estimator"] = "released_code"
    assert (
        "experiments.same_perturbation.estimator: shadow removes rows of the raw source, which "
        "partial_overlap of released_code replaces by others. Hint: leave one of them out, or set "
        "overlap_removal: raw" in errors_of(config)
    )


def test_everything_is_said_at_once(constant):
    constant["estimators"]["other"] = {"kind": "constnt"}
    constant["estimators"]["mine"]["runs"] = 60
    fixed = constant["experiments"]["same_perturbation"]["instances"]["fixed"]
    fixed |= {"sensor_nois": 1, "initial_pose": 0}
    message = errors_of(constant)
    assert "4 error(s)" in message
    for part in ("did you mean 'constant'?", "option of the kinds callable", "unknown cause"):
        assert part in message


# --- several estimators of one experiment ---------------------------------------------------------


def with_estimators(config, *names, **changes):
    """The configuration with an experiment `several` of these estimators."""
    several = {"based_on": "same_perturbation", "estimators": list(names)}
    config["experiments"]["several"] = several | changes
    return config


def test_several_estimators_are_an_experiment_each(config):
    with_estimators(config, "paper", "robust")
    config["run"] = ["several", "different_perturbations", "several_paper"]
    found = configuration.load(config)
    assert found.run == ("several_paper", "several_robust", "different_perturbations")
    assert found.joined == ("several",)
    assert found.by_estimator == {"several": {"paper": "several_paper", "robust": "several_robust"}}
    assert "several" not in found.experiments
    for name in ("paper", "robust"):
        config["experiments"]["mine"] = {"based_on": "same_perturbation", "estimator": name}
        written = configuration.load(config).experiments["mine"]
        assert replace(found.experiments[f"several_{name}"], name="mine") == written


def test_one_of_several_can_be_run_alone(config):
    config = with_estimators(config, "paper", "robust")
    config["run"] = ["several_robust"]
    found = configuration.load(config)
    assert (found.run, found.joined) == (("several_robust",), ())


def test_an_estimator_replaces_the_estimators_of_the_base(config):
    with_estimators(config, "paper", "robust")
    config["experiments"]["mine"] = {"based_on": "several", "estimator": "released_code"}
    config["experiments"]["others"] = {"based_on": "several", "estimators": ["released_code"]}
    found = configuration.load(config)
    assert found.experiments["mine"].estimator == "released_code"
    assert list(found.by_estimator["others"]) == ["released_code"]


HERE = "experiments.several"


@pytest.mark.parametrize(
    ("names", "changes", "says"),
    [
        (["papr"], {}, f"{HERE}.estimators, papr: unknown name 'papr', did you mean 'paper'?"),
        (["paper", "paper"], {}, f"{HERE}.estimators: ['paper', 'paper'] has non-unique elements"),
        ([], {}, f"{HERE}.estimators: expected at least one entry, found an empty list. Hint: giv"),
        (["paper"], {"estimators": "paper"}, f"{HERE}.estimators: expected a list, found 'paper'"),
        (
            ["paper"],
            {"estimator": "robust"},
            f"{HERE}: expected either estimator or estimators, found both. Hint: mappings of",
        ),
        (
            ["paper", "metres"],
            {},
            f"{HERE}.estimators: expected one divergence of all, found kl of paper, "
            "translation_rmse of metres: their Shapley values are of different quantities. Hint: ",
        ),
        (
            ["paper", "sector"],
            {},
            f"{HERE}.estimators: sector perturbs in another way than paper: overlap_shape: sector, "
            "and paper as usual. Hint: ",
        ),
        (
            ["robust", "mine"],
            {},
            f"{HERE}.estimators, mine: the kind constant cannot see partial_overlap. Hint: name",
        ),
        (
            ["robust", "paper"],
            {"instances": {"fixed": {"range_bias": 0.1}}},
            f"{HERE}.estimators, paper: range_bias with noise_draws: 1 of paper, expected at least",
        ),
    ],
)
def test_mistakes_of_several_estimators_are_named(constant, names, changes, says):
    constant["estimators"]["metres"] = {"based_on": "paper", "divergence": "translation_rmse"}
    constant["estimators"]["sector"] = {"based_on": "paper", "overlap_shape": "sector"}
    assert says in errors_of(with_estimators(constant, *names, **changes))


def test_a_name_that_is_there_already_is_named(config):
    with_estimators(config, "paper")
    config["experiments"]["several_paper"] = {"based_on": "same_perturbation"}
    assert "experiments: two are named several_paper; one of them is <experiment>_<" in errors_of(
        config
    )


def test_two_expansions_of_one_name_are_an_error(config):
    config["estimators"]["paper_again"] = {"based_on": "paper"}
    config["estimators"]["again"] = {"based_on": "paper"}
    with_estimators(config, "paper_again")
    config["experiments"]["several_paper"] = {"based_on": "several", "estimators": ["again"]}
    assert "two are named several_paper_again" in errors_of(config)


# --- causes that need something -------------------------------------------------------------------


@pytest.mark.parametrize("name", ["range_bias", "motion_distortion"])
def test_what_few_draws_cannot_show_is_refused_and_said_why(config, name):
    config["estimators"]["mine"] = {"based_on": "robust"}
    config["experiments"]["same_perturbation"] |= {"estimator": "mine"}
    config["experiments"]["same_perturbation"]["instances"]["fixed"][name] = 0.02
    for draws in (10, 20):
        config["estimators"]["mine"]["noise_draws"] = draws
        assert (
            f"{SAME}.estimator: {name} with noise_draws: {draws} of mine, expected at least 25: "
            "all runs of a noise draw share its error, which only many draws can show. Hint: "
            "noise_draws: 25" in errors_of(config)
        )
    config["estimators"]["mine"]["noise_draws"] = 25
    assert configuration.load(config).experiments["same_perturbation"].levels[name] == (0.02,)


@pytest.mark.parametrize("share", [-0.1, 1, 1.5])
def test_all_of_the_information_cannot_be_taken_away(config, share):
    config["experiments"]["same_perturbation"]["instances"]["fixed"]["under_constrained"] = share
    message = errors_of(config)
    assert f"{SAME}.instances.fixed.under_constrained: {share} is " in message
    assert "that is taken away, below 1" in message


def test_a_sector_does_not_go_with_the_released_codes_overlap(config):
    config["estimators"]["mine"] = {"based_on": "released_code", "overlap_shape": "sector"}
    assert (
        "estimators.mine.overlap_shape: sector removes rows of the raw source, which "
        "overlap_removal: noisy replaces by others. Hint: use overlap_removal: raw"
        in errors_of(config)
    )


def test_a_scanner_that_is_not_known_is_named(config):
    config["estimators"]["paper"]["sensor"] = "hokuyo_utm_30l"
    assert "unknown name 'hokuyo_utm_30l', did you mean 'hokuyo_utm_30lx'?" in errors_of(config)


def test_simulated_scans_have_no_column_of_times(config):
    simulated = {"scene": "apartment", "beams": 4000}
    config["data"]["mine"] = {"scans": 3, "simulated": simulated, "time": "stamp"}
    assert "data.mine.time: simulated scans have no columns, expected none" in errors_of(config)


# --- extreme and malicious values -----------------------------------------------------------------

GRID_NOISE = f"{GRID}.instances.grid.sensor_noise"
LEVELS_OF = {"start": 0, "stop": 0.1, "step": 0.01}
EXTREMES = [
    (
        GRID_NOISE,
        {**LEVELS_OF, "step": 1e-9},
        "sensor_noise: more than 1000 levels. Hint: ",
    ),
    (GRID_NOISE, {**LEVELS_OF, "step": 1e-300}, "more than 1000 levels"),
    (GRID_NOISE, {"start": 0.1, "stop": 0.1 + 1e-12, "step": 1e-13}, "equal after rounding"),
    (GRID_NOISE, [0, 1e308], "1e+308 is greater than the maximum of 100"),
    (GRID_NOISE, list(range(101)), "settings a pair, expected at most 100,000"),
    (f"{SAME}.instances.fixed.initial_pose", 1e308, "is greater than the maximum of 10000"),
    ("data.eth.scans", 10**9, "data.eth.scans: 1000000000 is greater than the maximum of 1000000"),
    ("estimators.paper.subsampling_probability", 1e-300, "is less than the minimum of 1e-05"),
    ("estimators.paper.maximum_distance", 1e300, "is greater than the maximum of 1000000.0"),
    ("estimators.paper.noise_draws", 10**12, "is greater than the maximum of 10000"),
    ("perturbation.initial_pose_rotation", 1e300, "is greater than the maximum of 180"),
    ("seed", 10**30, "is greater than the maximum"),
    ("data.eth\n", {"scans": 2, "folder": {"path": "x"}}, "does not match"),
    (f"data.{'e' * 300}", {"scans": 2, "folder": {"path": "x"}}, "is too long"),
    ("data.eth.title", "a\x1b[31mb", "data.eth.title: "),
    ("data.eth.title", "a\nb", "data.eth.title: "),
]


@pytest.mark.parametrize(
    ("path", "value", "message"), EXTREMES, ids=[f"{m[0]}={m[1]}"[:60] for m in EXTREMES]
)
def test_extreme_values_are_named_and_hang_nothing(config, path, value, message):
    if path == GRID_NOISE:
        del config["experiments"]["different_perturbations"]["waterfall"]
        config["experiments"]["different_perturbations"]["figures"] = ["summary"]
    if value == list(range(101)):
        grid = config["experiments"]["different_perturbations"]["instances"]["grid"]
        grid["initial_pose"] = {"start": 1, "stop": 3, "step": 0.01}
    change(config, path, value)
    assert message in errors_of(config)


def test_a_waterfall_is_of_one_pair_however_it_is_named(config):
    config["experiments"]["same_perturbation"]["figures"] = ["waterfall"]
    assert "waterfall shows one pair, and the experiment has several" in errors_of(config)
    config["data"]["two"] = {"scans": 2, "simulated": {"scene": "plain", "beams": 4000}}
    config["experiments"]["same_perturbation"]["sequences"] = ["two"]
    assert configuration.load(config).experiments["same_perturbation"].figures == ("waterfall",)


class TestWhatIf:
    CHANGES = {"more": {"normal_neighbours": "20"}, "closer": {"initial_pose": 0.5}}  # noqa: RUF012

    def changed(self, config, name="different_perturbations"):
        config["experiments"][name]["what_if"] = self.CHANGES
        return config

    def test_each_change_is_an_experiment_of_the_explained_instance(self, config):
        found = configuration.load(self.changed(config))
        names = {name: f"different_perturbations_{name}" for name in self.CHANGES}
        assert found.what_if == {"different_perturbations": names}
        assert set(found.planned) == {*found.run, *names.values()}
        base = found.experiments["different_perturbations"]
        more, closer = (found.experiments[name] for name in names.values())
        assert more.pairs == base.pairs and more.figures == ()
        assert more.levels == {name: (value,) for name, value in base.waterfall.items()}
        assert closer.levels == {**more.levels, "initial_pose": (0.5,)}
        assert found.estimators[more.estimator] == PAPER.with_options(normal_neighbours=20)
        assert found.estimators[closer.estimator] == PAPER

    def test_what_is_based_on_it_has_changes_of_its_own(self, config):
        self.changed(config, "same_perturbation")
        config["experiments"]["other"] = {"based_on": "same_perturbation", "estimator": "robust"}
        found = configuration.load(config)
        assert found.estimators["other_more"] == ROBUST.with_options(normal_neighbours=20)

    def test_several_estimators_have_none(self, config):
        self.changed(config, "same_perturbation")
        config["experiments"]["same_perturbation"]["estimators"] = ["paper", "robust"]
        del config["experiments"]["same_perturbation"]["estimator"]
        assert "several estimators, expected one that the changes are of" in errors_of(config)

    @pytest.mark.parametrize("section", ["estimators", "experiments"])
    def test_a_name_that_is_taken_is_refused(self, config, section):
        self.changed(config, "same_perturbation")
        block = {"estimators": {"based_on": "robust"}}.get(
            section, config["experiments"]["different_perturbations"]
        )
        config[section]["same_perturbation_more"] = block
        assert "what_if.more: same_perturbation_more is an" in errors_of(config)

    def test_of_a_grid_the_instance_must_be_named(self, config):
        del self.changed(config)["experiments"]["different_perturbations"]["waterfall"]
        assert "what_if: missing different_perturbations.waterfall" in errors_of(config)


class TestHere:
    """`instances: here`: the causes that scans show are the players, and what is told of others."""

    HERE = "experiments.same_perturbation.instances"

    def here(self, config, instances, **changes):
        block = config["experiments"]["same_perturbation"]
        block |= {"instances": instances, "figures": ["summary"], **changes}
        return config

    def test_the_causes_that_scans_show_are_the_players(self, config):
        found = configuration.load(self.here(config, "here")).experiments["same_perturbation"]
        assert found.causes == ("sensor_noise", "partial_overlap", "under_constrained")
        assert (found.levels, found.waterfall) == ({}, None)

    def test_what_is_told_is_played_too(self, config):
        config = self.here(config, {"here": {"initial_pose": "4", "icp_randomness": 2}})
        found = configuration.load(config).experiments["same_perturbation"]
        assert found.levels == {"initial_pose": (4.0,), "icp_randomness": (2.0,)}
        assert found.causes == (
            "sensor_noise",
            "initial_pose",
            "partial_overlap",
            "under_constrained",
            "icp_randomness",
        )

    def test_the_overlap_is_lost_as_in_the_diagnosis(self, config):
        found = configuration.load(self.here(config, "here"))
        shape = {
            name: found.preset(name).estimator.causes["partial_overlap"].overlap_shape
            for name in ("same_perturbation", "different_perturbations")
        }
        assert shape == {"same_perturbation": "sector", "different_perturbations": "scattered"}

    @pytest.mark.parametrize(
        ("instances", "message"),
        [
            ("heer", "instances: unknown name 'heer', did you mean 'here'?"),
            (
                {"here": {"sensor_noise": 0.02}},
                "instances.here.sensor_noise: its level is diagnosed of each pair, expected none.",
            ),
            (
                {"here": {"range_bias": 0.02}},
                "instances.here.range_bias: not visible in a pair of scans, and nothing that a "
                "robot knows of itself, expected some of initial_pose, icp_randomness.",
            ),
            ({"here": {"initial_pose": -1}}, "here.initial_pose: -1 is less than or equal to"),
            ({"here": {"initial_pos": 2}}, "did you mean 'initial_pose'?"),
        ],
    )
    def test_of_other_causes_no_level_is_known(self, config, instances, message):
        assert message in errors_of(self.here(config, instances))

    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"figures": ["waterfall"]}, "figures: waterfall shows one instance, and each pair"),
            (
                {"waterfall": {"sensor_noise": 0.05}},
                "waterfall: which instance a pair has is known only when it is diagnosed.",
            ),
            (
                {"scenes": [{"sequence": "eth", "reference": 0, "source": 1}]},
                "scenes: which instance a pair has is known only when it is diagnosed.",
            ),
            (
                {"what_if": {"more": {"runs": 200}}},
                "what_if: `instances: here` has another instance in each pair",
            ),
            (
                {"dependence": [["sensor_noise", "initial_pose"]]},
                "dependence: unknown cause of the experiment 'initial_pose'",
            ),
            (
                {"pairs": [{"sequence": "eth", "reference": 0, "source": 1}], "sequences": None},
                "pairs: one pair of eth, expected at least 2: a pair is diagnosed beside the",
            ),
            (
                {"estimator": "released_code"},
                "estimator: instances: here removes a sector: overlap_shape: sector removes rows",
            ),
            (
                {"estimator": "sheet"},
                "sensor: velodyne_vlp_16 gives sensor_noise another unit than the diagnosis finds",
            ),
        ],
    )
    def test_what_needs_one_known_instance_does_not_go_with_it(self, config, changes, message):
        config["estimators"]["sheet"] = {"based_on": "paper", "sensor": "velodyne_vlp_16"}
        config = self.here(config, "here", **changes)
        block = config["experiments"]["same_perturbation"]
        config["experiments"]["same_perturbation"] = {
            key: value for key, value in block.items() if value is not None
        }
        assert message in errors_of(config)

    def test_nothing_is_learned_from_it(self, config):
        config = self.here(config, "here")
        config["estimators"]["mine"] = {"kind": "learned", "training": "same_perturbation"}
        config["experiments"]["again"] = {
            **config["experiments"]["same_perturbation"],
            "estimator": "mine",
            "instances": {"fixed": {"sensor_noise": 0.05}},
        }
        config["run"] = ["same_perturbation", "again"]
        assert "same_perturbation has the levels that are diagnosed of each pair" in errors_of(
            config
        )
