"""The documentation agrees with the code: pages, links, commands, configurations, examples."""

import json
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from textwrap import indent

import known_measurements
import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import PAPER_CONFIG, REPOSITORY
from jsonschema import Draft202012Validator
from project import TINY, Project
from snakemake.cli import get_argument_parser

from docs import generate
from icpshap import causes, cli, options, presets, registrations, schema, tables
from icpshap import config as settings
from icpshap.estimators import KINDS
from icpshap.estimators.perturb import Perturbation
from icpshap.explanation import readings
from icpshap.export import FORMATS
from icpshap.one_pair import given
from icpshap.one_pair.explanation import Explanation

DOCS = REPOSITORY / "docs"
EXTENDING = DOCS / "extending.md"
PAGES = [REPOSITORY / "README.md", *sorted(DOCS.glob("*.md"))]
SCHEMA = schema.configuration()
CONFIG_FILES = [REPOSITORY / "config.yaml", *sorted((REPOSITORY / "config").glob("*.yaml")), TINY]


def by_name(path):
    return str(path.relative_to(REPOSITORY))


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(), re.M | re.S)


def named_blocks():
    """Path and content of every file, or part of one, that the page on extending has."""
    heading = r"^[^\n]*`([\w/]+\.(?:py|yaml))`[^`\n]*:\n\n"
    return re.findall(heading + r"```\w+\n(.*?)^```$", EXTENDING.read_text(), re.M | re.S)


def prose(path):
    """A page without its code blocks."""
    return re.sub(r"^```.*?^```$", "", path.read_text(), flags=re.M | re.S)


def laid_over(base, overlay):
    """As --configfile does it: mappings are merged, all else is replaced."""
    if not (isinstance(base, dict) and isinstance(overlay, dict)):
        return overlay
    return {**base, **{key: laid_over(base.get(key), value) for key, value in overlay.items()}}


# --- generated pages ------------------------------------------------------------------------------


def test_generated_pages_are_up_to_date():
    names = [by_name(path) for path in generate.outdated()]
    assert not names, f"run: python -m docs.generate ({', '.join(names)} would change)"


def test_every_key_and_every_column_is_described():
    page = generate.configuration()
    assert [key for key in keys_of(SCHEMA) if f"| `{key}` |" not in page] == []
    page = generate.tables()
    for table in tables.TABLES:
        assert f"## {table}\n" in page
        columns = tables.columns(table, causes.named(generate.INSTANCE))
        assert [c.name for c in columns if generate.plain(c.description) not in page] == []


def test_every_kind_and_every_cause_is_described():
    page = generate.configuration()
    for kind in KINDS:
        assert f"### `kind: {kind}`\n" in page
    for name, cause in causes.CAUSES.items():
        (row,) = [
            line for line in page.splitlines() if line.startswith(f"| `{name}` | {cause.title}")
        ]
        assert generate.plain(cause.meaning) in row


def keys_of(block):
    """All keys of a schema."""
    if isinstance(block, list):
        return {key for part in block for key in keys_of(part)}
    if not isinstance(block, dict):
        return set()
    own = block.get("properties", {})
    own = set(own) if isinstance(own, dict) else set()
    return own.union(*(keys_of(value) for value in block.values()))


def test_the_figure_has_the_same_bytes_each_time():
    assert generate.coalitions() == generate.coalitions()


# --- links ----------------------------------------------------------------------------------------


def anchors(path):
    """Anchors that GitHub gives the headings of a page."""
    headings = re.findall(
        r"^#+ (.*)$", re.sub(r"```.*?```", "", path.read_text(), flags=re.S), re.M
    )
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", PAGES, ids=by_name)
def test_links_lead_somewhere(path):
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(path)):
        if re.match(r"https?://", target):
            continue
        file, _, anchor = target.partition("#")
        linked = (path.parent / file).resolve() if file else path
        if not linked.exists() or (anchor and anchor not in anchors(linked)):
            broken.append(target)
    assert not broken


@pytest.mark.parametrize("path", PAGES, ids=by_name)
def test_named_files_exist(path):
    named = re.findall(r"`((?:config|docs|icpshap|reference|tests|workflow)/[\w./]*)`", prose(path))
    written_by_the_user = [found for found, _ in named_blocks()]
    missing = [name for name in named if not (REPOSITORY / name).exists()]
    assert set(missing) <= set(written_by_the_user)


def test_every_page_is_in_the_index():
    index = (DOCS / "README.md").read_text()
    pages = [path.name for path in DOCS.glob("*.md") if path.name != "README.md"]
    assert [name for name in pages if f"]({name})" not in index] == []


# --- commands -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Command:
    """A documented snakemake command and the page it is on."""

    page: Path
    line: str

    @property
    def arguments(self):
        return get_argument_parser().parse_args(shlex.split(self.line)[1:])


COMMANDS = [
    Command(path, part.strip())
    for path in PAGES
    for block in blocks(path, "bash")
    for part in re.split(r"\n|&&", block)
    if re.match(r"\S*snakemake\b", part.strip())
]


def test_there_are_commands():
    assert len(COMMANDS) > 5


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.line)
def test_commands_are_valid(command):
    arguments = command.arguments
    base = PAPER_CONFIG
    for file in arguments.configfile or []:
        # A file of the repository, or one that the page tells the user to write.
        assert (REPOSITORY / file).is_file() or f"`{file}`" in prose(command.page)
        if (REPOSITORY / file).is_file():
            base = laid_over(base, yaml.safe_load((REPOSITORY / file).read_text()))
    overrides = [part.partition("=") for part in arguments.config or []]
    overlay = {key: yaml.safe_load(value) for key, _, value in overrides}
    if overlay:
        settings.load(laid_over(base, overlay))
    for word in shlex.split(command.line):
        assert not re.search(r"[\[\]{}]", word) or f"'{word}'" in command.line, "zsh needs quotes"


# Of the command icpshap; a line may begin with variables of the environment and end in a file.
ONE_PAIR_COMMANDS = [
    pytest.param(found[1], id=found[1])
    for path in PAGES
    for block in blocks(path, "bash")
    for line in block.splitlines()
    if (found := re.match(r"(?:[A-Z_]+=\S+ )*(?:\.venv/bin/)?icpshap ([^>]*)", line))
]


@pytest.mark.parametrize("line", ONE_PAIR_COMMANDS)
def test_commands_of_one_pair_are_valid(line):
    typed = cli._parser().parse_args(cli._joined(shlex.split(line)))
    if "to" in typed:
        assert typed.to in FORMATS
        return
    changes = cli._what_if(typed.what_if) if "what_if" in typed else None
    causes = cli._causes(typed) if "sensor_noise" in typed else None
    asked = given.given(causes, cli._estimator(typed), None, changes, None)
    assert asked.levels
    name = getattr(typed, "register", None)
    assert not name or ":" in name or callable(getattr(registrations, name))


def test_every_part_of_an_explanation_is_described():
    page = (DOCS / "one_pair.md").read_text().partition("## What comes back")[2]
    described = set(re.findall(r"`(\w+)(?:\(\))?`", page.partition("\n## ")[0]))
    parts = {name for name in vars(Explanation) if not name.startswith("_")}
    parts |= {field.name for field in fields(Explanation)}
    assert parts <= described


# --- options are said once ------------------------------------------------------------------------


@pytest.mark.parametrize("path", CONFIG_FILES[:-1], ids=by_name)
def test_the_first_line_names_the_schema_for_editors(path):
    first = path.read_text().splitlines()[0]
    named = re.fullmatch(r"# yaml-language-server: \$schema=(\S+)", first)[1]
    assert (path.parent / named).resolve() == generate.EDITORS_SCHEMA


@pytest.mark.parametrize("path", CONFIG_FILES, ids=by_name)
def test_the_schema_for_editors_accepts_the_configurations(path):
    rules = json.loads(generate.EDITORS_SCHEMA.read_text())
    Draft202012Validator.check_schema(rules)
    Draft202012Validator(rules).validate(yaml.safe_load(path.read_text()))


def test_editors_know_the_patterns():
    """Theirs are JavaScript's, to which Python's \\A and \\Z are the letters A and Z."""
    assert r"\\Z" not in generate.editors_schema()
    assert r"\\A" not in generate.editors_schema()


def test_the_estimators_of_config_yaml_are_the_presets(paper):
    assert paper.estimators == {
        "paper": presets.PAPER,
        "released_code": presets.RELEASED_CODE,
        "robust": presets.ROBUST,
        "lidar": presets.LIDAR,
    }


def test_config_yaml_spells_out_every_option_of_the_paper():
    assert PAPER_CONFIG["estimators"]["paper"] == presets.PAPER.options


def test_units_in_the_comments_of_config_yaml_are_those_of_the_options():
    described = schema.estimator("monte_carlo")["properties"] | options.properties(Perturbation)
    said = dict(re.findall(r"^  +(\w+): [\w.-]+ # (\w+)$", CONFIG_FILES[0].read_text(), re.M))
    units = {key: unit_of(described[key]) for key in said if key in described}
    assert units == {key: unit for key, unit in said.items() if key in described}
    given = {**PAPER_CONFIG["estimators"]["paper"], **PAPER_CONFIG["perturbation"]}
    assert {key for key in given if unit_of(described[key]) not in ("", "-")} <= set(said)


def unit_of(described):
    """The unit at the end of an option's meaning; "" for what is no number."""
    match = re.search(r"\[(\S+)\]\.$", described["description"])
    return match[1] if match else ""


# --- configurations -------------------------------------------------------------------------------

EXAMPLES = [
    pytest.param(block, id=f"{path.name}-{number}")
    for path in PAGES
    for number, block in enumerate(blocks(path, "yaml"))
    if set(yaml.safe_load(block)) <= set(SCHEMA["properties"])
    # What needs an extension is tested with it, below.
    and (path != EXTENDING or block not in [found for _, found in named_blocks()])
]


@pytest.mark.parametrize("block", EXAMPLES)
def test_example_configurations_are_valid(block):
    settings.load(laid_over(PAPER_CONFIG, yaml.safe_load(block)))


@pytest.mark.parametrize("block", EXAMPLES)
def test_editors_find_no_fault_with_example_configurations(block):
    Draft202012Validator(schema.for_editors()).validate(yaml.safe_load(block))


def test_own_scans_start_from_lidar():
    """Its runs in a wrong basin are left out, so that one of 100 does not set the unit of f."""
    assert presets.LIDAR.options["wrong_basins"] == "leave_out"
    examples = blocks(REPOSITORY / "README.md", "yaml") + blocks(DOCS / "own_scans.md", "yaml")
    experiments = [
        experiment
        for block in examples
        for experiment in yaml.safe_load(block).get("experiments", {}).values()
    ]
    assert len(experiments) > 3
    assert {experiment["estimator"] for experiment in experiments} == {"lidar"}


# Words before a colon that are something else.
NO_KEYS = {"order", "range", "reason", "shown_by", "told", "zsh"}


@pytest.mark.parametrize("path", PAGES, ids=by_name)
def test_named_keys_exist(path):
    code = re.findall(r"`([^`\n]+)`", prose(path))
    dotted = [
        text for text in code if re.match(r"(perturbation|data|estimators|experiments)\.", text)
    ]
    assert [text for text in dotted if not is_path_of(SCHEMA, text.split("."))] == []
    pairs = [re.match(r"([a-z_]+): ", text) for text in code]
    assert {match[1] for match in pairs if match} - keys_of(SCHEMA) <= NO_KEYS


def is_path_of(block, keys):
    """Whether a path of keys leads somewhere in a schema; names of a user's own are any word."""
    if not keys:
        return True
    forms = [block, *block.get("oneOf", [])]
    properties = {key: value for form in forms for key, value in form.get("properties", {}).items()}
    if keys[0].endswith("[]"):
        items = [part["items"] for part in parts(properties[keys[0][:-2]])]
        return any(is_path_of(item, keys[1:]) for item in items)
    if isinstance(block.get("additionalProperties"), dict):
        return is_path_of(block["additionalProperties"], keys[1:])
    if keys[0] == "<cause>":
        return set(properties) == set(causes.CAUSES)
    return keys[0] in properties and is_path_of(properties[keys[0]], keys[1:])


def parts(block):
    return [part for part in block.get("oneOf", [block]) if "items" in part]


# --- examples of extending.md ---------------------------------------------------------------------

READINGS = "icpshap/explanation/readings.py"
SMALL = {"runs": 60, "subsampling_probability": 0.2, "maximum_iterations": 20}

LOAD = """
import json, sys
from icpshap import config

for each in json.load(sys.stdin):
    config.load(each)
"""

ROUNDED_AFTER_THE_NOISE = """
import numpy as np
from icpshap.causes import CAUSES
from icpshap.data.pair import Pair
from icpshap.estimators import Estimator, perturb
from icpshap.plan import Setting

points = np.random.default_rng(0).uniform(2, 6, (50, 3))
pair = Pair.measured(points, points, np.eye(4), 0.2)
streams = perturb.Streams(1, "pair", 0, 1)
estimator = Estimator.of("monte_carlo", {}).of_causes(["quantisation", "sensor_noise"])
for noise in (0, 0.5):
    setting = Setting.at({"quantisation": 0.05, "sensor_noise": noise})
    (group,) = perturb.groups(pair, [setting], estimator, np.ones(6), streams)
    (start,) = group.starts
    for cloud in (group.reference, start.source):
        assert np.allclose(cloud / 0.05, np.round(cloud / 0.05))
    if not noise:
        assert np.abs(group.reference - points).max() <= 0.025 + 1e-12
cause = CAUSES["quantisation"]()
assert cause.move(points, "source", cause.off, 0, streams) is points
"""


def my_extensions():
    """The configuration of the page, put together."""
    config = {}
    for path, block in named_blocks():
        if path == "my_extensions.yaml":
            config = laid_over(config, yaml.safe_load(block))
    return config


def extend(code):
    """Put every file and every entry of the page where the page says."""
    python = [(path, block) for path, block in named_blocks() if path.endswith(".py")]
    for path, block in python:
        if path != READINGS:
            assert not (code / path).exists()
            (code / path).write_text(block)
    function, entry = (block for path, block in python if path == READINGS)
    text = (code / READINGS).read_text()
    start = "READINGS = {\n"
    assert text.count(start) == 1
    added = f"{function}\n\n{start}{indent(entry, '    ')}"
    (code / READINGS).write_text(text.replace(start, added))


def write_scans(folder, pair, name, **layout):
    """The scans of a pair, and their poses, as a folder of files."""
    folder.mkdir()
    for index, points in enumerate((pair.reference, pair.source)):
        table = pd.DataFrame(points, columns=list("xyz"))
        table.to_csv(folder / name.format(index), index=False, **layout)
    poses = [np.eye(4), pair.T_reference_source]
    (folder / "poses.txt").write_text(
        "".join(" ".join(map(repr, pose.ravel().tolist())) + "\n" for pose in poses)
    )


@pytest.fixture(scope="module")
def before(tmp_path_factory, room_pair):
    """A project in which an experiment that knows nothing of them has run."""
    project = Project(tmp_path_factory.mktemp("extensions"))
    write_scans(project.folder / "as_before", room_pair, "scan_{}.csv")
    config = {
        "sequences": ["as_before"],
        "run": ["as_before"],
        "data": {"as_before": {"scans": 2, "folder": {"path": "as_before"}}},
        "estimators": {"paper": SMALL},
        "experiments": {
            "as_before": {
                "estimator": "paper",
                "pairs": [{"sequence": "as_before", "reference": 0, "source": 1}],
                "instances": {"fixed": {"sensor_noise": 0.02, "initial_pose": 1.5}},
                "figures": [],
            }
        },
    }
    (project.folder / "as_before.yaml").write_text(yaml.safe_dump(config))
    project.run("--configfile", "as_before.yaml", "--", "results/as_before/shap.parquet")
    return project


@pytest.fixture(scope="module")
def extended(before, tmp_path_factory):
    """The same working directory, with the extended code."""
    project = before.with_copied_code(tmp_path_factory.mktemp("code"))
    extend(project.code)
    return project


@pytest.fixture(scope="module")
def finished(extended, room_pair):
    """The extended code has run the configuration of the page, on small clouds."""
    write_scans(extended.folder / "my_scans", room_pair, "scan_{}.asc", sep=" ", header=False)
    config = laid_over(my_extensions(), {"estimators": {"paper": SMALL}})
    (extended.folder / "my_extensions.yaml").write_text(yaml.safe_dump(config))
    extended.run("--configfile", "my_extensions.yaml")
    return extended.folder / "results"


def run_python(extended, program, told=""):
    done = subprocess.run(
        [sys.executable, "-c", program],
        input=told,
        cwd=extended.code,
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_every_configuration_is_valid(extended):
    own = [yaml.safe_load(path.read_text()) for path in CONFIG_FILES]
    configs = [laid_over(PAPER_CONFIG, each) for each in [*own, my_extensions()]]
    run_python(extended, LOAD, json.dumps(configs))


@pytest.mark.slow
def test_what_does_not_name_them_registers_nothing_again(extended):
    planned = extended.planned(
        "--configfile", "as_before.yaml", "--", "results/as_before/shap.parquet"
    )
    # Another reading means other code to read by.
    assert set(planned) <= {"explain_sequence", "join_sequences", "total"}


@pytest.mark.slow
def test_rounding_comes_after_the_noise(extended):
    run_python(extended, ROUNDED_AFTER_THE_NOISE)


@pytest.mark.slow
def test_they_keep_the_contracts(extended):
    """The tests of every cause and kind find the new ones by their being there."""
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(REPOSITORY / "tests", extended.code / "tests", ignore=ignored)
    shutil.copy(REPOSITORY / "pyproject.toml", extended.code)
    files = ["tests/causes/test_contract.py", "tests/estimators/test_kinds.py"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-n0", *files, "-k", "quantisation or constant"],
        cwd=extended.code,
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_the_cause_is_a_player(finished):
    (row,) = pd.read_parquet(finished / "rounded/shap.parquet").itertuples()
    assert (row.quantisation, row.sensor_noise) == (0.05, 0.02)
    assert row.phi_quantisation + row.phi_sensor_noise == pytest.approx(row.f)
    assert row.phi_quantisation_low <= row.phi_quantisation <= row.phi_quantisation_high
    figures = finished / "rounded/figures"
    assert (figures / "dependence_quantisation_by_sensor_noise.svg").is_file()


@pytest.mark.slow
def test_the_estimator_is_blind(finished):
    uncertainty = pd.read_parquet(finished / "rounded_constant/uncertainty.parquet")
    assert (uncertainty["f"] == 0).all()
    (row,) = pd.read_parquet(finished / "rounded_constant/shap.parquet").itertuples()
    assert row.phi_quantisation == row.phi_sensor_noise == row.f == 0
    assert np.isnan([row.phi_quantisation_low, row.phi_quantisation_high]).all()
    assert row.no_interval and not row.interval_over
    assert not list(finished.glob("rounded_constant/**/runs"))


@pytest.mark.slow
def test_the_registration_is_explained(finished):
    (row,) = pd.read_parquet(finished / "rounded_mine/shap.parquet").itertuples()
    assert (row.n_runs, row.n_failed) == (60, 0)
    assert row.phi_quantisation + row.phi_sensor_noise == pytest.approx(row.f)
    uncertainty = pd.read_parquet(finished / "rounded_mine/uncertainty.parquet")
    assert (uncertainty["success_rate"] > 0.9).all()


@pytest.mark.slow
def test_the_reading_is_read(finished):
    (row,) = pd.read_parquet(finished / "rounded_translation/shap.parquet").itertuples()
    (other,) = pd.read_parquet(finished / "rounded/shap.parquet").itertuples()
    assert row.base_value == 0
    assert row.f != other.f
    caption = finished / "rounded_translation/figures/summary.txt"
    assert "entropy difference of translation" in caption.read_text()


@pytest.mark.slow
def test_all_are_in_the_report(finished):
    report = (finished / "report.html").read_text()
    for name in my_extensions()["run"]:
        assert name in report
    assert "quantisation" in report


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("1 2 3\n4 5\n", "line 2: 2 columns, expected 3"),
        ("1 2 3\n\n4 5 x\n", "line 3, column z: 'x' is not a number"),
    ],
)
def test_the_format_is_strict(tmp_path, content, said):
    path = tmp_path / "scan.asc"
    path.write_text(content)
    with pytest.raises(settings.UserError, match=said):
        format_of_the_page()["read"](path)


def test_the_format_leaves_rows_that_are_not_finite_in(tmp_path):
    path = tmp_path / "scan.asc"
    path.write_text("1 2 3\n\n 4\t5 nan \n")
    assert format_of_the_page()["read"](path) == pytest.approx(
        np.array([[1, 2, 3], [4, 5, np.nan]]), nan_ok=True
    )


def format_of_the_page():
    namespace = {}
    exec(dict(named_blocks())["icpshap/data/formats/blank_separated.py"], namespace)
    return namespace


def test_the_export_format_works():
    namespace = {"__name__": "deviations"}
    exec(dict(named_blocks())["icpshap/export/deviations.py"], namespace)
    lines = namespace["Deviations"]().texts(known_measurements.drive())[""].splitlines()
    assert [line.split()[:2] for line in lines] == [["0", "1"], ["1", "2"], ["2", "3"]]
    deviations = np.array(lines[0].split()[2:], dtype=float)
    covariance = known_measurements.drive()[0].covariance
    np.testing.assert_array_equal(deviations, np.sqrt(np.diagonal(covariance)))


def example(name):
    return next(block for block in blocks(EXTENDING, "python") if name in block)


def test_the_reading_works():
    function, entry = (block for path, block in named_blocks() if path == READINGS)
    namespace = dict(vars(readings))
    exec(f"{function}\nREADINGS = {{{entry}}}", namespace)
    reading = namespace["READINGS"]["translation_entropy_difference"]
    clean = readings.Moments(np.diag([1.0, 2, 3, 4, 5, 6]), np.float64(20))
    scale = np.diag([9.0, 9, 9, 4, 4, 4])
    perturbed = readings.Moments(clean.covariance @ scale, np.float64(20))
    # Twice the standard deviation in three directions; rotation does not count.
    for unbiased in (False, True):
        assert reading.evaluate(clean, perturbed, unbiased) == pytest.approx(3 * np.log(2))


def test_the_outlier_filter_works():
    namespace = {"np": np, "dataclass": dataclass}
    exec(example("class Closest"), namespace)
    assert namespace["Closest"](5).rank(np.array([10, 5, 3])).tolist() == [4, 4, 2]
