"""Configurations that nobody should write: extreme values, other types, hostile words."""

import copy
import math
from functools import partial

import numpy as np
import yaml
from snakemake.common.configfile import load_configfile
from snakemake.exceptions import WorkflowError

from benchmarks.faults import in_process
from benchmarks.faults.outcome import RIGHT, Fault, Outcome, of_call, said_of
from icpshap import config as configuration
from icpshap import plan

GRID = ("experiments", "tiny_fixed", "instances")
TINY = ("estimators", "tiny")
LONG = "k" * 300
NUMBERS = (
    1e300,
    -1e300,
    1e-300,
    1e308,
    -1,
    0,
    2**63,
    10**30,
    math.nan,
    math.inf,
    -math.inf,
    "1e400",
)
OTHERS = (
    None,
    True,
    -1,
    0.5,
    1e300,
    math.nan,
    "",
    "word",
    [],
    [[]],
    {},
    {"key": 1},
    [None],
    "\x00",
)
CAUSES = ("sensor_noise", "initial_pose", "partial_overlap")


def grid(**levels):
    return {"grid": levels}


# Path, value, what the error must say; a valid configuration is as good.
EXTREME = [
    (GRID, grid(sensor_noise={"start": 0, "stop": 1, "step": 1e-9}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 0, "stop": 1, "step": 1e-300}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 0, "stop": 1e308, "step": 1}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 0, "stop": 1, "step": 1e308}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 1, "stop": 0, "step": 0.1}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 0, "stop": 1e-13, "step": 1e-14}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 0, "stop": 1, "step": 0}), "sensor_noise"),
    (GRID, grid(sensor_noise={"start": 0, "stop": 1, "step": -0.1}), "sensor_noise"),
    (GRID, grid(sensor_noise=[0.05, 0.05 + 1e-17]), "sensor_noise"),
    (GRID, grid(sensor_noise=[0.05, 0.05 + 1e-15]), "sensor_noise"),
    (GRID, grid(sensor_noise=[0.05, 0.05]), "sensor_noise"),
    (GRID, grid(sensor_noise=[1e308]), "sensor_noise"),
    (GRID, grid(sensor_noise=[1e-300]), "sensor_noise"),
    (GRID, grid(sensor_noise=[[0.05]]), "sensor_noise"),
    (GRID, grid(sensor_noise=[]), "sensor_noise"),
    (GRID, grid(sensor_noise=list(range(100_000))), "sensor_noise"),
    (GRID, grid(**{name: list(np.arange(1, 200) / 200) for name in CAUSES}), "instances"),
    (GRID, grid(initial_pose=[1e308]), "initial_pose"),
    (GRID, grid(initial_pose=[1e-300]), "initial_pose"),
    (GRID, grid(initial_pose=[0]), "initial_pose"),
    (GRID, grid(initial_pose=[-1]), "initial_pose"),
    (GRID, grid(partial_overlap=[1.5]), "partial_overlap"),
    (GRID, grid(gravity=[1]), "gravity"),
    (GRID, grid(**{f"cause_{k}": [1] for k in range(8)}), "cause_0"),
    (GRID, {"fixed": {name: 1 for name in "abcdefgh"}}, "'a'"),
    (GRID, {"fixed": {"sensor_noise": 1e308}}, "sensor_noise"),
    (GRID, {"fixed": {"sensor_noise": math.nan}}, "sensor_noise"),
    (GRID, {"fixed": {}, "grid": {}}, "instances"),
    (GRID, {"fixed": {}}, "instances"),
    (("data", "own", "scans"), 10**9, "scans"),
    (("data", "own", "scans"), 10**30, "scans"),
    (("data", "tiny_room", "scans"), 10**9, "scans"),
    (("data", "tiny_room", "simulated", "beams"), 10**12, "beams"),
    (("experiments", "tiny_fixed", "replicates"), 10**9, "replicates"),
    ((*TINY, "runs"), 10**9, "runs"),
    ((*TINY, "kind"), "unknown_kind", "unknown_kind"),
    ((*TINY, "kind"), ["monte_carlo"], "kind"),
    ((*TINY, "based_on"), "tiny", "tiny"),
    ((*TINY, "based_on"), ["paper"], "based_on"),
    ((*TINY, "based_on"), {"a": 1}, "based_on"),
    ((*TINY, "noise_draws"), 7, "noise_draws"),
    (("runs_per_job",), 10**30, "runs_per_job"),
    (("seed",), 10**40, "seed"),
    (("seed",), -1, "seed"),
    (("sequences",), ["own", "own"], "sequences"),
    (("sequences",), [["own"]], "sequences"),
    (("sequences",), {"own": 1}, "sequences"),
    (("run",), [{}], "run"),
    (("run",), [], "run"),
    (("data", "key\nwith a line end"), {"scans": 2, "folder": {"path": "scans"}}, "key\\nwith"),
    (("data", "../up"), {"scans": 2, "folder": {"path": "scans"}}, "../up"),
    (("data", LONG), {"scans": 2, "folder": {"path": "scans"}}, LONG[:20]),
    (("experiments", LONG), {"based_on": "tiny_fixed"}, LONG[:20]),
    (("estimators", LONG), {"based_on": "tiny"}, LONG[:20]),
    (("experiments", "a/b"), {"based_on": "tiny_fixed"}, "a/b"),
    (("experiments", "comparison"), {"based_on": "tiny_fixed"}, "comparison"),
    (("data", "own", "folder", "path"), "\x00", "path"),
    (("data", "own", "folder", "path"), "", "path"),
    (("data", "own", "folder", "path"), "a\nb", "path"),
    (("data", "own", "folder", "path"), "p" * 5000, "path"),
    (("data", "own", "folder", "columns"), ["x", "y", "r"], "columns"),
    (("data", "own", "folder", "columns"), ["x"] * 1001, "columns"),
    (("data", "own", "folder", "files"), ["s0.csv"], "files"),
    (("data", "own", "folder", "files"), ["s0.csv", "../..", "/dev/zero"], "files"),
    (("data", "own", "folder", "quaternion"), "zxyw", "quaternion"),
    (("data", "own", "folder", "guess"), [1, 2, 3], "guess"),
    (("data", "own", "folder", "guess"), "guess.txt", "guess"),
    (("data", "own", "title"), "two\nlines", "title"),
    (("data", "own", "title"), "\x1b[31mred\x07", "title"),
    (("data", "own", "title"), "t" * 100_000, "title"),
    (("data", "own", "title"), "", "title"),
    (("data", "own", "archive"), {"url": "file:///etc/passwd"}, "url"),
    (("data", "own", "archive"), {"path": "a.zip"}, "archive"),
    (("experiments", "tiny_fixed", "figures"), ["summary", "summary"], "figures"),
    (("experiments", "tiny_fixed", "figures"), ["drawing"], "drawing"),
    (("experiments", "tiny_fixed", "dependence"), [["sensor_noise"]], "dependence"),
    (("experiments", "tiny_fixed", "pairs"), "all", "pairs"),
    (("unknown_key",), 1, "unknown_key"),
]
TEXTS = {
    "a key twice": "seed: 1\nseed: 2\n",
    "a deep key twice": "estimators:\n  tiny: {runs: 60, runs: 70}\n",
    "no mapping": "- 1\n- 2\n",
    "a tabulator": "seed:\t1\n\tb: 2\n",
    "an open bracket": "run: [a, b\n",
    "another object": "seed: !!python/object/apply:os.getcwd []\n",
    "a null byte": "seed: \x00\n",
    "an unknown anchor": "seed: *nowhere\n",
    "a key that is a list": "[a, b]: 1\n",
    "a key that is a number": "estimators: {1: {based_on: tiny}}\n",
    "a key that is null": "estimators: {null: {based_on: tiny}}\n",
    "a key that is a truth value": "data: {yes: {scans: 2, folder: {path: scans}}}\n",
    "a date": "seed: 2001-01-01\n",
    "a merged mapping": "estimators: {tiny: {<<: {runs: 60}, runs: 70}}\n",
    "nothing": "",
    "a null for each block": "data:\nestimators:\nexperiments:\n",
    "lists a million times": "a: &a [1,1,1,1,1,1,1,1,1,1]\n"
    + "".join(
        f"{y}: &{y} [{','.join([f'*{x}'] * 10)}]\n" for x, y in zip("abcdef", "bcdefg", strict=True)
    ),
}


def faults(folder, config, seed, number, short):
    """number: of nodes that are replaced at random, each by something of another type."""
    for path, value, name in EXTREME:
        words = f"{'.'.join(path)!a:.60}: {value!a:.60}"
        yield Fault(words, partial(_value, folder, config, path, value, name))
    for path in list(_numbers(config)):
        for value in NUMBERS[:: 6 if short else 1]:
            words = f"{'.'.join(map(str, path))}: {value!r}"
            yield Fault(words, partial(_value, folder, config, path, value, _name(path)))
    for words, text in TEXTS.items():
        yield Fault(f"a file of configuration with {words}", partial(_text, folder, config, text))
    generator = np.random.default_rng(seed)
    paths = list(_nodes(config))
    for _ in range(number):
        path = paths[generator.integers(len(paths))]
        value = OTHERS[generator.integers(len(OTHERS))]
        words = f"{'.'.join(map(str, path))}: {value!r} in its place"
        yield Fault(words, partial(_value, folder, config, path, value, _name(path)))


def _name(path):
    """The last name on a path; the place in a list has none."""
    return next(str(key) for key in reversed(path) if isinstance(key, str))


def _nodes(node, path=()):
    """Path of every value in a configuration."""
    if path:
        yield path
    items = enumerate(node) if isinstance(node, list) else ()
    for key, value in node.items() if isinstance(node, dict) else items:
        yield from _nodes(value, (*path, key))


def _numbers(config):
    for path in _nodes(config):
        value = config
        for key in path:
            value = value[key]
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield path


def replaced(config, path, value):
    config = copy.deepcopy(config)
    block = config
    for key in path[:-1]:
        block = block[key] if isinstance(block, list) else block.setdefault(key, {})
    block[path[-1]] = value
    return config


def _value(folder, config, path, value, name):
    # A list of names is one key: its entries are called by it.
    names = [name, *(str(key) for key in path[2:] if isinstance(key, str)), *map(str, path[-1:])]
    if isinstance(value, str) and len(value) > 3:
        names.append(value[:60])
    return _planned(folder, replaced(config, path, value), *names)


def _planned(folder, config, *names):
    """Loaded as the Snakefile loads it, and every job counted."""

    def load_and_plan():
        with in_process.inside(folder):
            found = in_process.planner(config)
        for name, experiment in found.config.experiments.items():
            for sequence in experiment.pairs:
                found.jobs(name, sequence)
            plan.instances(experiment.levels)
        return True

    return of_call(load_and_plan, bool, *names)


def _text(folder, config, text):
    """A file of configuration, read as Snakemake and the Snakefile read it."""
    path = f"{folder}/hostile.yaml"
    with open(path, "wb") as file:
        file.write(text if isinstance(text, bytes) else text.encode())
    try:
        found = load_configfile(path)
        configuration.check_file(path)
    except WorkflowError as error:
        return said_of(str(error), "hostile.yaml", "YAML")
    except configuration.ConfigError as error:
        return said_of(str(error), "hostile.yaml")
    except (yaml.YAMLError, UnicodeDecodeError, TypeError, RecursionError) as error:
        return Outcome("crash", f"{type(error).__name__}: {error}"[:300])
    names = [*found, "seed", "data", "estimators", "own", "tiny"]
    return _planned(folder, {**config, **found}, *names) if found else RIGHT
