"""The configuration: what it says, and what it is told when it is wrong."""

import re
import shutil

import numpy as np
import pytest
import yaml
from conftest import REPOSITORY
from snakemake.utils import update_config

from icpshap import config as settings
from icpshap import plan
from icpshap.causes import NAMES
from icpshap.explanation.uncertainty import MINIMUM_RUNS
from icpshap.jobs import digests as provenance
from icpshap.parameters import Estimator


def errors_of(config):
    with pytest.raises(settings.SettingsError) as caught:
        settings.load(config)
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
    assert paper.experiments["same_perturbation"].levels == {
        "sensor_noise": (0.05,),
        "initial_pose": (1.5,),
        "partial_overlap": (0.05,),
    }
    assert sum(len(pairs) for pairs in paper.experiments["same_perturbation"].pairs.values()) == 267
    assert paper.estimators["paper"].runs == 100


@pytest.mark.parametrize("name", ["demo", "released_code", "robust"])
def test_every_shipped_override_loads(config, name):
    update_config(config, yaml.safe_load((REPOSITORY / f"config/{name}.yaml").read_text()))
    loaded = settings.load(config)
    assert all(experiment in loaded.experiments for experiment in loaded.run)


def test_levels_are_rounded_and_include_the_stop():
    levels = settings.expand_levels({"start": 0, "stop": 0.1, "step": 0.01})
    assert levels == (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1)
    assert settings.expand_levels({"start": 1, "stop": 1.25, "step": 0.1}) == (1.0, 1.1, 1.2)


def test_strings_of_the_command_line_become_what_the_schema_wants(config):
    config["seed"] = "7"
    config["estimators"]["paper"] |= {
        "stop_rotation": "1e-3",
        "maximum_distance": "null",
        "common_random_numbers": "false",
        "runs": "50",
    }
    loaded = settings.load(config)
    paper = loaded.estimators["paper"]
    assert (loaded.seed, paper.stop_rotation, paper.runs) == (7, 1e-3, 50)
    assert paper.maximum_distance is None
    assert paper.common_random_numbers is False


@pytest.mark.parametrize("runs", ["1e2", 100.0, "100.0", "100"])
def test_an_integer_may_be_written_as_a_float(config, runs):
    config["estimators"]["paper"]["runs"] = runs
    loaded = settings.load(config).estimators["paper"].runs
    assert (loaded, type(loaded)) == (100, int)


def test_a_large_integer_loses_no_digit_on_the_command_line(config):
    config["seed"] = "9007199254740993"
    assert settings.load(config).seed == 9007199254740993


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
    runs = settings.read_schema()["$defs"]["estimator"]["properties"]["runs"]
    assert runs["minimum"] == MINIMUM_RUNS
    assert f"fewer than {MINIMUM_RUNS}" in runs["description"]


def test_an_estimator_takes_what_it_does_not_give(config):
    config["estimators"]["mine"] = {"based_on": "robust", "runs": 200}
    mine, robust = (settings.load(config).estimators[name] for name in ("mine", "robust"))
    assert (mine.runs, robust.runs) == (200, 100)
    assert mine.stop_rotation == robust.stop_rotation == 1e-5


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
    ("seed", "x", "seed: 'x' is not of type 'integer'"),
    ("seed", -1, "seed: -1 is less than the minimum of 0"),
    ("data.eth.scans", 1, "data.eth.scans: 1 is less than the minimum of 2"),
    ("data.eth.folder", {"path": "x"}, "data.eth: expected exactly one of archive, folder, simu"),
    ("data.eth.archive", None, "data.eth: expected exactly one of archive, folder, simulated, fo"),
    ("data.eth.archive", {"bytes": 3}, "data.eth.archive: expected url, or path for a ZIP on disk"),
    ("data.eth.archive.url", "ftp://x", "data.eth.archive.url: 'ftp://x' does not match"),
    ("data.Eth", {"scans": 3}, "'Eth' does not match"),
    ("estimators.paper.metric", "point_to_plan", "did you mean 'point_to_plane'?"),
    ("estimators.paper.kept_links", 0, "0 is less than or equal to the minimum of 0"),
    ("estimators.paper.runs", None, "estimators.paper: missing runs"),
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
        "instances: expected either grid or fixed, found both. Hint: mappings of several config",
    ),
    (
        "experiments.comparison",
        {"based_on": "same_perturbation"},
        "results has a folder comparison",
    ),
    ("data.figures", {"scans": 2, "folder": {"path": "x"}}, "data.figures: the name is taken"),
    ("data.tables", {"scans": 2, "folder": {"path": "x"}}, "data.tables: the name is taken"),
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
        "the scale s must be above 0",
    ),
    (
        "experiments.different_perturbations.instances.grid.partial_overlap",
        [0, 1.5],
        "lambda must be at most 1",
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
            assert child.get("description") or "$ref" in child, f"{where}.{key} has no description"
            walk(child, f"{where}.{key}")
        if schema.get("type") in ("object", ["object", "null"]):
            assert "additionalProperties" in schema, f"{where} is open"
        for branch in schema.get("oneOf", []):
            walk(branch, where)

    schema = settings.read_schema()
    walk(schema, "config")
    for name, child in schema["$defs"].items():
        walk(child, name)


def test_every_key_of_the_estimator_has_a_comment_in_the_config():
    text = (REPOSITORY / "config.yaml").read_text()
    block = text[text.index("  paper:") : text.index("  released_code:")]
    keys = re.findall(r"^    (\w+):", block, flags=re.MULTILINE)
    assert sorted(keys) == sorted(Estimator.__dataclass_fields__)
    schema = settings.read_schema()["$defs"]["estimator"]["properties"]
    assert sorted(schema) == sorted([*keys, "based_on"])


def test_registration_is_the_part_that_decides_the_pose_samples(paper):
    registration = paper.estimators["paper"].registration
    assert not hasattr(registration, "divergence")
    assert registration.runs == 100
    assert np.isclose(registration.kept_links, 0.7)


def test_another_error_text_is_no_reason_to_register_again(tmp_path, monkeypatch):
    library = tmp_path / "icpshap"
    shutil.copytree(REPOSITORY / "icpshap", library)
    monkeypatch.setattr(provenance, "LIBRARY", library)
    script = REPOSITORY / "workflow" / "scripts" / "run_icp.py"

    def digest_after_a_change_of(name):
        with open(library / name, "a") as module:
            module.write("changed = True\n")
        return provenance.code_digest(script)

    before = provenance.code_digest(script)
    assert digest_after_a_change_of("config.py") == before
    assert digest_after_a_change_of("parameters.py") != before
