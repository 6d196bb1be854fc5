"""The documentation agrees with the code: pages, links, commands, configurations, examples."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import PAPER_CONFIG, REPOSITORY
from snakemake.cli import get_argument_parser

from docs import generate
from icpshap import config as settings
from icpshap import tables
from icpshap.explanation import readings as divergence

DOCS = REPOSITORY / "docs"
PAGES = [REPOSITORY / "README.md", *sorted(DOCS.glob("*.md"))]
SCHEMA = settings.read_schema()


def by_name(path):
    return str(path.relative_to(REPOSITORY))


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(), re.M | re.S)


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
    page = generate.configuration(SCHEMA, PAPER_CONFIG)
    assert [key for key in keys_of(SCHEMA) if f"| `{key}` |" not in page] == []
    page = generate.tables()
    for table, columns in tables.TABLES.items():
        assert f"## {table}\n" in page
        assert [c.name for c in columns if generate.plain(c.description) not in page] == []


def keys_of(schema):
    """All keys of a schema."""
    if isinstance(schema, list):
        return {key for part in schema for key in keys_of(part)}
    if not isinstance(schema, dict):
        return set()
    own = schema.get("properties", {})
    own = set(own) if isinstance(own, dict) else set()
    return own.union(*(keys_of(value) for value in schema.values()))


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
    for file in arguments.configfile or []:
        # A file of the repository, or one that the page tells the user to write.
        assert (REPOSITORY / file).is_file() or f"`{file}`" in prose(command.page)
    overrides = [part.partition("=") for part in arguments.config or []]
    overlay = {key: yaml.safe_load(value) for key, _, value in overrides}
    if overlay:
        settings.load(laid_over(PAPER_CONFIG, overlay))
    for word in shlex.split(command.line):
        assert not re.search(r"[\[\]{}]", word) or f"'{word}'" in command.line, "zsh needs quotes"


# --- configurations -------------------------------------------------------------------------------

EXAMPLES = [
    pytest.param(block, id=f"{path.name}-{number}")
    for path in PAGES
    for number, block in enumerate(blocks(path, "yaml"))
    if set(yaml.safe_load(block)) <= set(SCHEMA["properties"])
]


@pytest.mark.parametrize("block", EXAMPLES)
def test_example_configurations_are_valid(block):
    settings.load(laid_over(PAPER_CONFIG, yaml.safe_load(block)))


# Words before a colon that are something else.
NO_KEYS = {"range_bias", "reason", "zsh"}


@pytest.mark.parametrize("path", PAGES, ids=by_name)
def test_named_keys_exist(path):
    code = re.findall(r"`([^`\n]+)`", prose(path))
    dotted = [
        text for text in code if re.match(r"(perturbation|data|estimators|experiments)\.", text)
    ]
    assert [text for text in dotted if not is_path_of(SCHEMA, text.split("."))] == []
    pairs = [re.match(r"([a-z_]+): ", text) for text in code]
    assert {match[1] for match in pairs if match} - keys_of(SCHEMA) <= NO_KEYS


def is_path_of(schema, keys):
    """Whether a path of keys leads somewhere in a schema; names of a user's own are any word."""
    if "$ref" in schema:
        schema = SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]]
    if not keys:
        return True
    if keys[0].endswith("[]"):
        items = [part["items"] for part in parts(schema["properties"][keys[0][:-2]])]
        return any(is_path_of(item, keys[1:]) for item in items)
    if isinstance(schema.get("additionalProperties"), dict):
        return is_path_of(schema["additionalProperties"], keys[1:])
    return keys[0] in schema.get("properties", {}) and is_path_of(
        schema["properties"][keys[0]], keys[1:]
    )


def parts(schema):
    return [part for part in schema.get("oneOf", [schema]) if "items" in part]


# --- examples of extending.md ---------------------------------------------------------------------

EXTENDING = DOCS / "extending.md"

CHECK = """
import numpy as np, yaml
from icpshap import config as settings, plan, tables
from icpshap.estimators import monte_carlo as estimators, perturb as perturbation
from icpshap.report.figures.style import COLOURS
from icpshap.causes import NAMES, SOURCES

config = yaml.safe_load(open("config.yaml"))
for experiment in config["experiments"].values():
    for kind, levels in experiment["instances"].items():
        levels["range_bias"] = 0 if kind == "fixed" else [0]
    if "waterfall" in experiment:
        experiment["waterfall"]["range_bias"] = 0
loaded = settings.load(config)
# A source that is never on adds no setting.
assert len(plan.settings(loaded.experiments["different_perturbations"].levels, 1)) == 1332
assert len(plan.settings({name: (s.off, 9.0) for name, s in zip(NAMES, SOURCES)}, 1)) == 17
assert "phi_range_bias" in [column.name for column in tables.TABLES["shap"]]
assert set(COLOURS) == set(NAMES)

points = np.random.default_rng(0).normal(size=(50, 3))
pair = perturbation.Pair(points, 2 * points, np.eye(4), np.ones(50, dtype=bool))
sampler = estimators.Sampler(
    pair, loaded.estimators["paper"], 0.2, perturbation.Streams(1, "x", 0, 1)
)
for sigma in (0.0, 0.1):
    clean, biased = (sampler.noisy_clouds(sigma, bias, 0) for bias in (0.0, 0.3))
    for one, other, raw in zip(clean, biased, (points, points, 2 * points)):
        away = raw / np.linalg.norm(raw, axis=1, keepdims=True)
        np.testing.assert_allclose(other - one, 0.3 * away, atol=1e-12)
assert np.array_equal(sampler.noisy_clouds(0.0, 0.0, 0)[0], points)
"""


def test_the_uncertainty_source_works(tmp_path):
    for part in ("icpshap", "workflow", "config.yaml"):
        source = REPOSITORY / part
        copied = shutil.copytree if source.is_dir() else shutil.copy
        copied(source, tmp_path / part)
    (patch,) = blocks(EXTENDING, "diff")
    environment = {**os.environ, "GIT_CEILING_DIRECTORIES": str(tmp_path.parent)}
    for command, said in ((["git", "apply"], patch), ([sys.executable, "-"], CHECK)):
        done = subprocess.run(
            command, input=said, cwd=tmp_path, env=environment, text=True, capture_output=True
        )
        assert done.returncode == 0, done.stderr


def example(name):
    return next(block for block in blocks(EXTENDING, "python") if name in block)


def test_the_divergence_works():
    readings = {}
    namespace = {**vars(divergence), "READINGS": readings}
    exec(example("def _translation_entropy"), namespace)
    exec(example("READINGS["), namespace)
    reading = readings["translation_entropy_difference"]
    clean = divergence.Spread(np.diag([1.0, 2, 3, 4, 5, 6]), np.float64(20), None, None)
    scale = np.diag([9.0, 9, 9, 4, 4, 4])
    perturbed = divergence.Spread(clean.covariance @ scale, np.float64(20), None, None)
    # Twice the standard deviation in three directions; rotation does not count.
    for unbiased in (False, True):
        assert reading.evaluate(clean, perturbed, unbiased) == pytest.approx(3 * np.log(2))


def test_the_outlier_filter_works():
    namespace = {"np": np, "dataclass": dataclass}
    exec(example("class Closest"), namespace)
    assert namespace["Closest"](5).rank(np.array([10, 5, 3])).tolist() == [4, 4, 2]
