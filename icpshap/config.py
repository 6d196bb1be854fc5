"""From a configuration to typed experiments, with every error of it reported at once.

The schema (`schema`, made from the options) says which keys there are, their types and ranges; this
module adds what a schema cannot say: names that must exist, pairs that must lie in a sequence,
causes and options that must go together.
"""

import difflib
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite, prod
from pathlib import Path
from typing import Any

import yaml

from icpshap import presets, schema, what_if
from icpshap.causes import CAUSES, MOST, named, shown, variants_of
from icpshap.data.layout import REGISTER
from icpshap.diagnosis.curves import AS_DIAGNOSED
from icpshap.errors import UserError
from icpshap.estimators import KINDS
from icpshap.estimators.perturb import Perturbation
from icpshap.presets import DEFAULT_KIND, PAPER, Preset
from icpshap.schema import EXPERIMENT_KEYS
from icpshap.selection import FEWEST_OF_A_DRIVE, Selection


class ConfigError(UserError):
    """The configuration is wrong; `errors` and the message list everything that is."""

    def __init__(self, message: str, errors: Collection[str] = ()) -> None:
        super().__init__(message)
        self.errors = errors


@dataclass(frozen=True)
class Sequence:
    """One recording; exactly one of archive, folder and simulated is a mapping."""

    key: str
    title: str
    scans: int
    drop_non_finite: bool
    time: str | None
    archive: dict | None
    folder: dict | None
    simulated: dict | None

    @property
    def kind(self) -> str:
        return next(kind for kind in DATA_KINDS if getattr(self, kind) is not None)

    @property
    def registers(self) -> bool:
        """Whether ICP makes the poses."""
        return self.folder is not None and self.folder.get("poses") == REGISTER


MOST_SETTINGS = 100_000  # of a pair; the paper's grid has 1,331
DATA_KINDS = ("archive", "folder", "simulated")
# Folders of results/ and results/<experiment>/ that hold something else.
RESERVED = {"experiments": ("comparison", "so_far"), "data": ("figures", "tables")}
# Keys of an experiment of which it has one; an experiment takes that of its base unless it has any.
WHO_ESTIMATES = ("estimator", "estimators")
# Couples of the paper's dependence plots: the Shapley value of the first, coloured by the second.
PAPER_COUPLES = (
    ("sensor_noise", "initial_pose"),
    ("initial_pose", "partial_overlap"),
    ("partial_overlap", "initial_pose"),
)


@dataclass(frozen=True)
class Experiment:
    """Pairs by sequence, and levels by cause; every combination of levels is explained.

    measured: causes of which the diagnosis of each pair gives the level, where it is `here`.
    """

    name: str
    estimator: str
    pairs: dict[str, tuple[tuple[int, int], ...]]
    levels: dict[str, tuple[float, ...]]
    replicates: int
    figures: tuple[str, ...]
    waterfall: dict[str, float] | None
    dependence: tuple[tuple[str, str], ...]
    scenes: dict[str, tuple[tuple[int, int], ...]]
    what_if: dict[str, dict]
    measured: tuple[str, ...] = ()

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of the players, in the order of the registry."""
        return tuple(cause.name for cause in named([*self.levels, *self.measured]))


@dataclass(frozen=True)
class Config:
    """The whole configuration. `sequences` and `run` select among `data` and `experiments`.

    `by_estimator`: of each experiment of several estimators, which is none of `experiments` itself,
    the names of those that it is made of, by estimator; `joined` are those that are selected.
    `what_if`: of each experiment that has it, the names of the experiments that its changes make,
    by the name of the change; they run with it and are no part of `run`. `remarks`: what the
    selected sequences lack for what the selected experiments ask for, a line each.
    """

    seed: int
    sequences: tuple[str, ...]
    run: tuple[str, ...]
    joined: tuple[str, ...]
    runs_per_job: int
    stop_at_red: bool
    perturbation: Perturbation
    data: dict[str, Sequence]
    estimators: dict[str, Preset]
    experiments: dict[str, Experiment]
    by_estimator: dict[str, dict[str, str]]
    what_if: dict[str, dict[str, str]]
    remarks: tuple[str, ...]

    def preset(self, experiment: str) -> Preset:
        """The `Preset` of an experiment's name; its causes act as they were diagnosed, if so."""
        found = self.experiments[experiment]
        preset = self.estimators[found.estimator]
        return preset.with_options(**AS_DIAGNOSED) if found.measured else preset

    @property
    def planned(self) -> tuple[str, ...]:
        """Names of all experiments that are run: those selected, and what their what_if makes."""
        changed = [part for name in self.run for part in self.what_if.get(name, {}).values()]
        return (*self.run, *changed)


def load(config: Mapping[str, Any]) -> Config:
    """The typed `Config` of a configuration mapping.

    Strings in the place of numbers are accepted: that is how ``--config 'a={b: 1}'`` and YAML's
    ``1e-3`` arrive; so are integers written like 1e2. Raises ConfigError with one line for every
    error.
    """
    from jsonschema import Draft202012Validator  # loaded where a configuration is read

    config = _with_here(config)
    changed = _changed_estimators(config)
    if changed:
        blocks = {name: block for name, (_, block) in changed.items()}
        config = {**config, "estimators": {**blocks, **config["estimators"]}}
    kinds = _kinds(config)
    rules = schema.with_kinds({name: kind for name, kind in kinds.items() if kind in list(KINDS)})
    # Of an unknown key its name is enough: what it holds may be anything, and large.
    known = {key: value for key, value in config.items() if key in rules["properties"]}
    known = _coerce(known, rules)
    non_finite = dict(_non_finite(known))
    config = {**config, **known}
    violations = [
        violation
        for violation in _leaves(Draft202012Validator(rules).iter_errors(config))
        if tuple(violation.absolute_path) not in non_finite
    ]
    # Which names there are says more than that a name is a string.
    named = [tuple(found.absolute_path) for found in violations if found.validator == "enum"]
    violations = [
        violation
        for violation in violations
        if violation.validator != "type" or tuple(violation.absolute_path) not in named
    ]
    broken = {path[:2] for path in non_finite} | {
        tuple(violation.absolute_path)[:2]
        for violation in violations
        if violation.absolute_path or violation.validator == "required"
    }
    errors = [
        f"{_dotted(path)}: expected a finite number, found {value}. "
        "Hint: give a number, or null where that means no limit"
        for path, value in non_finite.items()
    ]
    errors += [line for violation in violations for line in _describe(violation, kinds)]
    errors += _inconsistencies(config, broken)
    if errors:
        for name, (where, _) in changed.items():
            errors = [error.replace(f"estimators.{name}", where) for error in errors]
        errors = list(dict.fromkeys(errors))
        lines = "\n".join(f"  - {error}" for error in errors)
        raise ConfigError(
            f"The configuration has {len(errors)} error(s):\n{lines}\n"
            "Hint: config.yaml explains every key; config/demo.yaml shows how to override them.",
            errors,
        )
    experiments, by_estimator, changes = _expanded(config["experiments"])
    run = [part for name in config["run"] for part in by_estimator.get(name, {name: name}).values()]
    return Config(
        seed=config["seed"],
        sequences=tuple(config["sequences"]),
        run=tuple(dict.fromkeys(run)),
        joined=tuple(name for name in config["run"] if name in by_estimator),
        runs_per_job=config["runs_per_job"],
        stop_at_red=config.get("stop_at_red", False),
        perturbation=Perturbation(**config["perturbation"]),
        data={key: _sequence(key, block) for key, block in config["data"].items()},
        estimators={
            name: Preset.of(**_inherited(config["estimators"], name))
            for name in config["estimators"]
        },
        experiments={name: _experiment(name, block, config) for name, block in experiments.items()},
        by_estimator=by_estimator,
        what_if=changes,
        remarks=tuple(_remarks(config, experiments, run)),
    )


def check_file(path: str | Path) -> None:
    """Raise ConfigError if a mapping of a YAML file names a key twice, which YAML would not say."""
    twice: list[tuple[int, tuple]] = []
    _find_twice(yaml.compose(Path(path).read_text(encoding="utf-8")), (), twice)
    if twice:
        lines = "\n".join(
            f"  - line {line}: {_dotted(where)} is there twice" for where, line in twice
        )
        raise ConfigError(
            f"{path}: {len(twice)} key(s) are given twice:\n{lines}\n"
            "Hint: keep one of each; the last would win without a word."
        )


def _find_twice(node, path, found):
    if isinstance(node, yaml.MappingNode):
        counted: Counter[Any] = Counter()
        for key, value in node.value:
            where = (*path, key.value)
            counted[key.value] += 1
            if counted[key.value] == 2:
                found.append((where, key.start_mark.line + 1))
            _find_twice(value, where, found)
    elif isinstance(node, yaml.SequenceNode):
        for number, item in enumerate(node.value):
            _find_twice(item, (*path, number), found)


def expand_levels(levels: list | Mapping[str, Any]) -> tuple[float, ...]:
    """Levels of one cause: a list as it is, else round(start + k step, 12).

    >>> expand_levels({"start": 0.1, "stop": 0.3, "step": 0.1})
    (0.1, 0.2, 0.3)
    """
    if isinstance(levels, list):
        return tuple(float(level) for level in levels)
    start, stop, step = (float(levels[key]) for key in ("start", "stop", "step"))
    count = int(min((stop - start) / step + 1e-9, schema.MOST_LEVELS)) + 1
    return tuple(round(start + k * step, 12) for k in range(count))


# --- building -------------------------------------------------------------------------------------


def _with_here(config):
    """A configuration that nobody has checked, with `instances: here` as an empty mapping."""
    experiments = config.get("experiments") if isinstance(config, dict) else None
    if not isinstance(experiments, dict):
        return config
    told = {
        name: {**block, "instances": {"here": {}}}
        for name, block in experiments.items()
        if isinstance(block, dict) and block.get("instances") == "here"
    }
    return {**config, "experiments": {**experiments, **told}}


def _kinds(config):
    """The kind of each estimator, as far as it can be told, by name of the estimator."""
    blocks = config.get("estimators") if isinstance(config, dict) else None
    blocks = blocks if isinstance(blocks, dict) else {}
    blocks = {name: block for name, block in blocks.items() if isinstance(block, dict)}
    found = {}
    for name in blocks:
        try:
            found[name] = _inherited(blocks, name).get("kind", DEFAULT_KIND)
        except _Unresolved:
            continue
    return found


def _sequence(key, block):
    return Sequence(
        key=key,
        title=block.get("title", key),
        scans=block["scans"],
        drop_non_finite=block.get("drop_non_finite", False),
        time=block.get("time"),
        **{kind: block.get(kind) for kind in DATA_KINDS},
    )


def _experiment(name, block, config):
    levels = _levels(block["instances"])
    measured = tuple(shown()) if "here" in block["instances"] else ()
    waterfall = block.get("waterfall") or block["instances"].get("fixed")
    couples = [couple for couple in PAPER_COUPLES if set(couple) <= {*levels, *measured}]
    return Experiment(
        name=name,
        estimator=block["estimator"],
        pairs=_pairs(block, config["data"]),
        levels=levels,
        replicates=block.get("replicates", 1),
        figures=tuple(block["figures"]),
        waterfall=waterfall and {cause: float(waterfall[cause]) for cause in levels},
        dependence=tuple(tuple(couple) for couple in block.get("dependence", couples)),
        scenes=_by_sequence(block.get("scenes", [])),
        what_if=block.get("what_if") or {},
        measured=measured,
    )


def _expanded(experiments):
    """The blocks of all experiments, of one estimator each, and which of them are joined.

    An experiment of several estimators is an experiment of each; their names, by estimator, are
    the second mapping's values; those of what an experiment's what_if makes the third's.
    """
    blocks: dict[str, dict] = {}
    by_estimator: dict[str, dict[str, str]] = {}
    changes: dict[str, dict[str, str]] = {}
    for name in experiments:
        block = _inherited(experiments, name)
        if "estimators" in block:
            by_estimator[name] = _names_by_estimator(name, block)
            parts = list(by_estimator[name].items())
        else:
            parts = [(block["estimator"], name)]
        blocks |= {part: {**block, "estimator": estimator} for estimator, part in parts}
        if block.get("what_if"):
            changes[name] = what_if.parts(name, block)
            blocks |= what_if.experiments(name, block)
    return blocks, by_estimator, changes


def _changed_estimators(config):
    """What the what_if of experiments makes of their estimators: (where it stands, block) by name.

    As far as it can be told of a configuration that nobody has checked.
    """
    experiments = config.get("experiments") if isinstance(config, dict) else None
    if not isinstance(experiments, dict) or not isinstance(config.get("estimators"), dict):
        return {}
    blocks = {name: block for name, block in experiments.items() if isinstance(block, dict)}
    found = {}
    for name in blocks:
        try:
            made = what_if.estimators(name, _inherited(blocks, name))
        except _Unresolved:
            continue
        for part, block in made.items():
            change = part.removeprefix(f"{name}_")
            found[part] = (f"experiments.{name}.what_if.{change}", block)
    return found


def _names_by_estimator(name, block):
    """Names of the experiments that one of several estimators expands into."""
    return {estimator: f"{name}_{estimator}" for estimator in block["estimators"]}


def _levels(instances):
    """Levels by cause of a grid, a fixed instance, or what is told of one that is diagnosed.

    In the order of the registry.
    """
    one = instances.get("fixed") or instances.get("here") or {}
    grid = instances.get("grid") or {name: [value] for name, value in one.items()}
    return {cause.name: expand_levels(grid[cause.name]) for cause in named(grid)}


def _players(instances):
    """Names of the causes of an experiment's instances."""
    return [*_levels(instances), *(shown() if "here" in instances else ())]


def _selection(block):
    """The `Selection` of an experiment's block; None if it lists its pairs."""
    if isinstance(block["pairs"], list):
        return None
    return Selection(**({} if block["pairs"] == "consecutive" else block["pairs"]))


def _pairs(block, data):
    """The pairs of an experiment's block by sequence; only sequences that have any."""
    selection = _selection(block)
    if selection is None:
        return _by_sequence(block["pairs"])
    found = {name: selection.pairs(data[name]["scans"]) for name in block["sequences"]}
    return {name: pairs for name, pairs in found.items() if pairs}


def _remarks(config, experiments, run):
    """What selected sequences lack for what experiments of the names `run` ask for."""
    data = {name: config["data"][name] for name in config["sequences"]}
    for name in dict.fromkeys(run):
        block = experiments[name]
        selection = _selection(block)
        for sequence in block["sequences"] if selection else ():
            if sequence in data:
                remark = selection.remark(sequence, data[sequence]["scans"])
                yield from [f"{name}: {remark}."] * bool(remark)
        for sequence, pairs in _pairs(block, config["data"]).items():
            if "drive" in block["figures"] and sequence in data and len(pairs) < FEWEST_OF_A_DRIVE:
                yield (
                    f"{name}: no figure drive of {sequence}: it has {len(pairs)} "
                    f"pair{'s' * (len(pairs) > 1)}, expected at least {FEWEST_OF_A_DRIVE}."
                )


def _by_sequence(pairs):
    result: dict[str, tuple] = {}
    for pair in pairs:
        indices = (pair["reference"], pair["source"])
        result[pair["sequence"]] = (*result.get(pair["sequence"], ()), indices)
    return result


def _inherited(blocks, name):
    """A block with the values of those it is based on. Raises _Unresolved if that leads nowhere."""
    block, names = blocks[name], [name]
    while "based_on" in block:
        base = block["based_on"]
        if not isinstance(base, str) or base not in blocks:
            raise _Unresolved(f"{names[-1]}.based_on: {unknown(base, blocks)}")
        if base in names:
            raise _Unresolved(f"{name}.based_on: circle {' -> '.join([*names, base])}")
        names.append(base)
        given = {key: value for key, value in block.items() if key != "based_on"}
        replaced = WHO_ESTIMATES if set(WHO_ESTIMATES) & set(given) else ()
        kept = {key: value for key, value in blocks[base].items() if key not in replaced}
        block = {**kept, **given}
    return block


class _Unresolved(ValueError):
    """A block is based on one that does not exist, or on itself."""


def _complete(section, blocks, name, required):
    """A block with what it inherits, or what is wrong with that, as (block, errors)."""
    try:
        block = _inherited(blocks, name)
    except _Unresolved as error:
        return None, [f"{section}.{error}"]
    missing = [key for key in required if key not in block]
    if missing:
        hint = "give them, or `based_on` another one that has them"
        return None, [f"{section}.{name}: missing {', '.join(missing)}. Hint: {hint}"]
    return block, []


# --- checking -------------------------------------------------------------------------------------


def _inconsistencies(config, broken):
    """What the schema cannot say, for every block that obeys it."""
    if any(path in broken for path in [(), ("data",), ("estimators",), ("experiments",)]):
        return
    data, estimators, experiments = config["data"], config["estimators"], config["experiments"]
    parts = [] if any(path[0] == "experiments" for path in broken) else _parts(experiments)
    runnable = [*experiments, *parts]
    for key, names, section in (("sequences", data, "data"), ("run", runnable, "experiments")):
        # A violation may lie in an entry of the list: its path is longer than the key's.
        for name in [] if any(path[:1] == (key,) for path in broken) else config[key]:
            if name not in names:
                yield f"{key}: {unknown(name, names)} Hint: define it under {section}"
    for section, names in RESERVED.items():
        for name in names:
            if name in config[section]:
                yield (
                    f"{section}.{name}: the name is taken, results has a folder {name} of its own. "
                    "Hint: choose another name"
                )
    for name, block in data.items():
        if not any(path[0] == "data" for path in broken):
            yield from _sequence_inconsistencies(f"data.{name}", block)
    for name in estimators:
        if not any(path[0] == "estimators" for path in broken):
            yield from _estimator_inconsistencies(name, estimators)
    sound = not any(path[0] == "estimators" for path in broken)
    for name in experiments:
        if not any(path[0] in ("experiments", "data") for path in broken):
            block, errors = _complete("experiments", experiments, name, EXPERIMENT_KEYS)
            yield from errors or _experiment_inconsistencies(f"experiments.{name}", block, data)
            if not errors:
                yield from _who_estimates(f"experiments.{name}", block, estimators, sound)
            if sound and not errors:
                yield from _training_inconsistencies(name, block, config)
        if not any(path[0] in ("experiments", "data") for path in broken):
            yield from _what_if_inconsistencies(name, experiments, estimators, sound)
    twice = [part for part, number in Counter(runnable).items() if number > 1]
    for part in twice:
        yield (
            f"experiments: two are named {part}; one of them is <experiment>_<estimator>, of "
            "`estimators`. Hint: choose another name for the experiment or for the estimator"
        )


def _sequence_inconsistencies(where, block):
    kinds = [kind for kind in DATA_KINDS if block.get(kind) is not None]
    if len(kinds) != 1:
        yield (
            f"{where}: expected exactly one of {', '.join(DATA_KINDS)}, "
            f"found {', '.join(kinds) or 'none'}. "
            "Hint: `archive: null` unsets a key of config.yaml"
        )
    if block.get("time") in ("x", "y", "z"):
        yield (
            f"{where}.time: {block['time']} is a coordinate, expected the column of the times. "
            "Hint: without such a column leave it out, and `scan_order` of the estimator counts"
        )
    if block.get("simulated") is not None and "time" in block:
        yield (
            f"{where}.time: simulated scans have no columns, expected none. "
            "Hint: leave it out; scan_order (tilt, or azimuth of a spinning scanner) is the order "
            "in which they are measured"
        )
    if block.get("simulated") is not None:
        yield from _simulated_inconsistencies(f"{where}.simulated", block["simulated"])
    if block.get("folder") is not None:
        yield from _folder_inconsistencies(where, block)
    archive = block.get("archive")
    if archive is not None and not {"url", "path"} & set(archive):
        yield f"{where}.archive: expected url, or path for a ZIP on disk"


def _simulated_inconsistencies(where, block):
    if block.get("rings") is None:
        if block["beams"] > schema.TILTING_BEAMS:
            yield (
                f"{where}.beams: {block['beams']}, expected at most {schema.TILTING_BEAMS}, which "
                "the tilting laser has. Hint: fewer, or rings for a spinning scanner"
            )
        if block.get("speed"):
            yield (
                f"{where}.speed: the tilting laser stands while it scans. "
                "Hint: leave it out, or give rings for a spinning scanner"
            )


def _folder_inconsistencies(where, block):
    folder, scans = block["folder"], block["scans"]
    where = f"{where}.folder"
    columns = folder.get("columns")
    if columns is not None and (missing := [axis for axis in "xyz" if axis not in columns]):
        yield (
            f"{where}.columns: no {', '.join(missing)} among {', '.join(columns)}, expected x, y "
            "and z. Hint: the others may be called as you like"
        )
    if columns is not None and block.get("time") not in (None, *columns):
        yield (
            f"{where}.columns: no {block['time']}, which is the `time` of the sequence. "
            "Hint: call the column of the times so"
        )
    files = folder.get("files")
    if files is not None and len(files) != scans:
        yield (
            f"{where}.files: {len(files)} files, expected as many as `scans: {scans}`. "
            "Hint: list every scan once, in order"
        )
    registers = folder.get("poses") == REGISTER
    if "guess" in folder and not registers:
        yield (
            f"{where}.guess: expected with `poses: {REGISTER}` alone, where ICP starts from it. "
            "Hint: leave it out, or set poses so"
        )
    if "quaternion" in folder and registers:
        yield (
            f"{where}.quaternion: expected with a pose file alone, and `poses: {REGISTER}` is "
            "none. Hint: leave it out"
        )
    guess = folder.get("guess")
    if isinstance(guess, list) and len(guess) not in (12, 16):
        yield (
            f"{where}.guess: {len(guess)} numbers, expected 12 or 16, the rows of the 3x4 or 4x4 "
            "matrix one after the other"
        )


def _estimator_inconsistencies(name, estimators):
    block, errors = _complete("estimators", estimators, name, ())
    if errors:
        yield from errors
        return
    kind = block.get("kind", DEFAULT_KIND)
    foreign = [key for key in block if key not in ("kind", "based_on", *presets.option_names(kind))]
    if foreign:
        base = estimators[name]["based_on"]
        yield (
            f"estimators.{name}: {', '.join(foreign)} of `based_on: {base}` "
            f"are no options of the kind {kind}. "
            "Hint: leave based_on out; every option has a default"
        )
        return
    if missing := [key for key in presets.required(kind) if key not in block]:
        yield (
            f"estimators.{name}: missing {', '.join(missing)}, which the kind {kind} needs. "
            "Hint: give them, or `based_on` another one that has them"
        )
        return
    preset = Preset.of(**block)
    returns, draws = preset.estimator.returned, preset.estimator.perturbing.noise_draws
    correction = preset.method.bias_correction
    if correction == "wishart" and (returns.drawn or not returns.exchangeable):
        yield (
            f"estimators.{name}.bias_correction: wishart holds for independent samples, which the "
            f"kind {kind} does not return. Hint: use none"
        )
    elif correction == "wishart" and preset.estimator.perturbing.common_random_numbers:
        yield (
            f"estimators.{name}.bias_correction: wishart holds for independent samples only. "
            "Hint: use jackknife, or common_random_numbers: false"
        )
    reading = preset.method.reading
    if not returns.samples and not reading.compares_with_clean:
        yield (
            f"estimators.{name}.divergence: {preset.method.divergence} is of pose samples, which "
            f"the kind {kind} does not return. Hint: use kl"
        )
    if correction == "jackknife" and not returns.units(draws):
        yield (
            f"estimators.{name}.bias_correction: jackknife leaves out independent runs, which the "
            f"kind {kind} does not return, or noise draws, of which there is one. "
            "Hint: use none, or more noise_draws"
        )
    if preset.estimator.perturbing.voxel_size is not None:
        for cause in preset.estimator.causes.values():
            if cause.replaces:
                yield (
                    f"estimators.{name}.voxel_size: the grid keeps points of the raw scans, which "
                    f"{cause.name} replaces by others. Hint: overlap_removal: raw, or leave out "
                    "voxel_size"
                )
    conflicts = [preset.estimator.kind.conflict]
    conflicts += [cause.conflict for cause in preset.estimator.causes.values()]
    for conflict in filter(None, conflicts):
        yield f"estimators.{name}.{conflict}"
    fewest = preset.estimator.kind.fewest_noise_draws
    if draws < fewest:
        yield (
            f"estimators.{name}.noise_draws: {draws}, expected at least {fewest}: the sensor's own "
            "noise is drawn, and fewer draws do not make a covariance. "
            f"Hint: noise_draws: {fewest}, or sensor_noise_by: closed_form"
        )
    runs = preset.estimator.number_of_runs
    if runs % draws:
        yield f"estimators.{name}.noise_draws: {draws} does not divide runs: {runs}"


def _parts(experiments):
    """Names of what experiments of several estimators expand into, as far as these resolve."""
    found = []
    for name in experiments:
        block, errors = _complete("experiments", experiments, name, ())
        if not errors and "estimators" in block:
            found += _names_by_estimator(name, block).values()
    return found


def _who_estimates(where, block, estimators, sound):
    """What is wrong with the estimators of an experiment; sound: whether those obey the schema."""
    given = [key for key in WHO_ESTIMATES if key in block]
    if not given:
        yield (
            f"{where}: missing estimator, or estimators for several. "
            "Hint: give one of them, or `based_on` another one that has it"
        )
    elif len(given) > 1:
        yield (
            f"{where}: expected either {' or '.join(given)}, found both. "
            "Hint: mappings of several config files are merged; give yours a name of its own, and "
            "`based_on` this one"
        )
    elif given == ["estimator"]:
        yield from _of_estimator(f"{where}.estimator", block, block["estimator"], estimators, sound)
    else:
        here = f"{where}.estimators"
        for name in block["estimators"]:
            yield from _of_estimator(f"{here}, {name}", block, name, estimators, sound)
        if sound:
            yield from _incomparable(here, block, estimators)


def _of_estimator(where, block, name, estimators, sound):
    if name not in estimators:
        yield f"{where}: {unknown(name, estimators)}"
    elif sound and (preset := _preset(estimators, name)):
        yield from _what_the_estimator_cannot(where, block, name, preset)


def _preset(estimators, name):
    """The preset of an estimator's name; None where its block is not sound."""
    try:
        return Preset.of(**_inherited(estimators, name))
    except (_Unresolved, TypeError):
        return None


def _incomparable(where, block, estimators):
    """Why the Shapley values of several estimators do not belong into one figure."""
    known = [name for name in block["estimators"] if name in estimators]
    presets_ = {name: preset for name in known if (preset := _preset(estimators, name))}
    divergences = {name: preset.method.divergence for name, preset in presets_.items()}
    if len(set(divergences.values())) > 1:
        told = ", ".join(f"{divergence} of {name}" for name, divergence in divergences.items())
        yield (
            f"{where}: expected one divergence of all, found {told}: their Shapley values are of "
            "different quantities. Hint: an estimator `based_on` one of these, with the divergence "
            "of the others"
        )
    variants = {
        name: variants_of(preset.estimator.of_causes(_players(block["instances"])).causes)
        for name, preset in presets_.items()
    }
    for name, variant in variants.items():
        first, usual = next(iter(variants.items()))
        if variant != usual:
            yield (
                f"{where}: {name} perturbs in another way than {first}: "
                f"{_options(variant) or 'as usual'}, and {first} {_options(usual) or 'as usual'}. "
                "Hint: an estimator `based_on` it, with the options of the others"
            )


def _options(variants):
    """The options by which causes are variants, as the configuration has them."""
    options = [f"{key}: {value}" for of in variants.values() for key, value in of.items()]
    return ", ".join(options)


def _what_the_estimator_cannot(where, block, name, preset):
    """Causes of an experiment that its estimator cannot see, or does not let act together."""
    players = [preset.estimator.causes[name] for name in _players(block["instances"])]
    if "here" in block["instances"]:
        yield from _not_as_diagnosed(where, preset)
    sees = preset.estimator.kind.sees
    for cause in players:
        if sees is not None and cause.name not in sees:
            yield (
                f"{where}: the kind {preset.estimator.kind.name} cannot see {cause.name}. "
                f"Hint: name only {', '.join(sees)}, or another estimator"
            )
    draws = preset.estimator.perturbing.noise_draws
    for cause in players:
        if draws < cause.fewest_noise_draws:
            yield (
                f"{where}: {cause.name} with noise_draws: {draws} of {name}, expected at least "
                f"{cause.fewest_noise_draws}: all runs of a noise draw share its error, which only "
                "many draws can show. "
                f"Hint: noise_draws: {cause.fewest_noise_draws}, in an estimator of its own, or "
                f"leave out {cause.name}"
            )
    replacing = [cause for cause in preset.estimator.causes.values() if cause.replaces]
    for cause in players if replacing else []:
        if cause.hook() in ("keep", "thin") and cause not in replacing:
            yield (
                f"{where}: {cause.name} removes rows of the raw source, which "
                f"{replacing[0].name} of {name} replaces by others. "
                "Hint: leave one of them out, or set overlap_removal: raw"
            )


def _not_as_diagnosed(where, preset):
    """Options of an estimator by which a level would mean another thing than in a diagnosis."""
    diagnosed = preset.with_options(**AS_DIAGNOSED).estimator.causes
    usual = variants_of(PAPER.with_options(**AS_DIAGNOSED).estimator.causes)
    for name in shown():
        if diagnosed[name].conflict:
            yield f"{where}: instances: here removes a sector: {diagnosed[name].conflict}"
        other = variants_of({name: diagnosed[name]}).get(name, {})
        if other != usual.get(name, {}):
            yield (
                f"{where}: {_options({name: other})} gives {name} another unit than the diagnosis "
                "finds its level in. Hint: an estimator `based_on` it without the option"
            )


def _what_if_inconsistencies(name, experiments, estimators, sound):
    block, errors = _complete("experiments", experiments, name, EXPERIMENT_KEYS)
    if errors or not block.get("what_if"):
        return
    where = f"experiments.{name}.what_if"
    if "estimators" in block:
        yield (
            f"{where}: {name} has several estimators, expected one that the changes are of. "
            "Hint: give it an experiment of its own with one `estimator`"
        )
        return
    if "here" in block["instances"]:
        yield (
            f"{where}: `instances: here` has another instance in each pair, expected one that the "
            "changes are tried on. Hint: leave it out, or give it an experiment with a fixed one"
        )
        return
    if what_if.explained(block) is None:
        yield f"{where}: missing {name}.waterfall, the instance of the grid that is run again"
        return
    made = what_if.experiments(name, block)
    for change, part in what_if.parts(name, block).items():
        yield from _who_estimates(f"{where}.{change}", made[part], estimators, sound)
        if part in experiments:
            yield f"{where}.{change}: {part} is an experiment already. Hint: choose another name"
        # A change is based on the experiment's estimator; one of that name would stand in its way.
        base = estimators.get(part, {}).get("based_on")
        if base != block.get("estimator"):
            yield f"{where}.{change}: {part} is an estimator already. Hint: choose another name"
        for cause in what_if.levels_of(block["what_if"][change]):
            if cause not in (what_if.explained(block) or ()):
                yield (
                    f"{where}.{change}.{cause}: the experiment does not name this cause, so it is "
                    "off. Hint: leave it out, or name it under instances"
                )


def _training_inconsistencies(name, block, config):
    """What is wrong with the experiment that the estimator of another one learns from."""
    for estimator in filter(config["estimators"].get, _estimators_of(block)):
        preset = _preset(config["estimators"], estimator)
        if preset is not None and preset.estimator.kind.training is not None:
            yield from _training_of(name, block, estimator, preset.estimator.kind, config)


def _estimators_of(block):
    """Names of the estimators of an experiment, as far as it says."""
    return block.get("estimators", [block["estimator"]] if "estimator" in block else [])


def _training_of(name, block, estimator, kind, config):
    """The same, of one estimator with a kind that learns."""
    data, estimators, experiments = config["data"], config["estimators"], config["experiments"]
    where, training = f"estimators.{estimator}.training", kind.training
    if training not in experiments:
        yield f"{where}: {unknown(training, experiments)} Hint: define it under experiments"
        return
    other, errors = _complete("experiments", experiments, training, EXPERIMENT_KEYS)
    if errors or any(
        any(_experiment_inconsistencies("", checked, data)) for checked in (block, other)
    ):
        return  # that is said where it is wrong
    if "here" in other["instances"]:
        yield (
            f"{where}: {training} has the levels that are diagnosed of each pair, expected some to "
            "learn from. Hint: name an experiment with a grid"
        )
        return
    if "estimator" not in other:
        yield (
            f"{where}: {training} has several estimators, expected one to learn from. "
            "Hint: name an experiment with one `estimator`"
        )
        return
    if other["estimator"] not in estimators:
        return
    teacher = _preset(estimators, other["estimator"])
    if teacher is not None and not teacher.estimator.returned.samples:
        yield (
            f"{where}: the estimator {other['estimator']} of {training} is of the kind "
            f"{teacher.estimator.kind.name}, which returns no pose samples to learn from. "
            "Hint: name an experiment whose estimator is of the kind monte_carlo"
        )
        return
    pairs = _pairs(other, data)
    parts = _names_by_estimator(name, block).values() if "estimators" in block else ()
    if {name, *parts} & set(config["run"]):
        yield from _training_not_selected(where, name, training, pairs, config)
    for sequence in _pairs(block, data):
        number = sum(len(pairs[known]) for known in pairs if known != sequence)
        if number < kind.fewest_pairs:
            yield (
                f"{where}: for {sequence} of {name}, {training} has {number} pairs of other "
                f"sequences to learn from, expected at least {kind.fewest_pairs}. "
                "Hint: more sequences, or more scans, there"
            )


def _training_not_selected(where, name, training, sequences, config):
    if training not in config["run"]:
        yield (
            f"{where}: {name} learns from {training}, which is not selected. "
            f"Hint: run: [{', '.join([*config['run'], training])}]"
        )
    missing = [sequence for sequence in sequences if sequence not in config["sequences"]]
    if missing:
        yield (
            f"{where}: {name} learns from all sequences of {training}, of which "
            f"{', '.join(missing)} are not selected. Hint: select them under sequences, or learn "
            "from an experiment that has only those that are"
        )


def _experiment_inconsistencies(where, block, data):
    listed = block["pairs"] if isinstance(block["pairs"], list) else []
    if not listed:
        if "sequences" not in block:
            form = "consecutive" if block["pairs"] == "consecutive" else "{...}"
            yield f"{where}.sequences: missing; `pairs: {form}` needs it"
        for sequence in block.get("sequences", []):
            if sequence not in data:
                yield f"{where}.sequences: {unknown(sequence, data)}"
    elif "sequences" in block:
        yield f"{where}.sequences: a list of pairs names its own sequences. Hint: remove the key"
    for key, pairs in (("pairs", listed), ("scenes", block.get("scenes", []))):
        for pair in pairs:
            if pair["sequence"] not in data:
                yield f"{where}.{key}: {unknown(pair['sequence'], data)}"
                continue
            scans = data[pair["sequence"]]["scans"]
            for role in ("reference", "source"):
                if pair[role] >= scans:
                    yield (
                        f"{where}.{key}: {role} {pair[role]} of {pair['sequence']} does not exist, "
                        f"expected 0 to {scans - 1} (data.{pair['sequence']}.scans is {scans})"
                    )
            if pair["reference"] == pair["source"]:
                yield f"{where}.{key}: reference and source are both scan {pair['source']}"
            elif key == "scenes" and not _is_registered(pair, block, data):
                yield (
                    f"{where}.scenes: {pair['sequence']} {pair['reference']}, {pair['source']} is "
                    "not one of the experiment's pairs. Hint: list it under pairs too"
                )
    if "here" in block["instances"]:
        yield from _here_inconsistencies(where, block, data)
        return
    if "waterfall" in block["figures"] and _number_of_pairs(block, data) > 1:
        yield (
            f"{where}.figures: waterfall shows one pair, and the experiment has several. "
            "Hint: leave it out, or give the pair an experiment of its own"
        )
    yield from _instance_inconsistencies(where, block)


def _here_inconsistencies(where, block, data):
    """What is wrong with an experiment whose instances are diagnosed."""
    here = f"{where}.instances.here"
    for name in block["instances"]["here"]:
        if CAUSES[name].shown_by:
            yield (
                f"{here}.{name}: its level is diagnosed of each pair, expected none. "
                "Hint: leave it out; `fixed` is for levels of your own"
            )
        elif not CAUSES[name].told:
            told = ", ".join(cause.name for cause in CAUSES.values() if cause.told)
            yield (
                f"{here}.{name}: not visible in a pair of scans, and nothing that a robot knows of "
                f"itself, expected some of {told}. Hint: leave it out; `fixed` is for levels of "
                "your own"
            )
    for key in ("waterfall", "scenes"):
        if block.get(key):
            yield (
                f"{where}.{key}: which instance a pair has is known only when it is diagnosed. "
                "Hint: leave it out, or give it an experiment with fixed levels"
            )
    for figure in ("waterfall", "drive"):
        if figure in block["figures"]:
            yield (
                f"{where}.figures: {figure} shows one instance, and each pair has its own. "
                "Hint: leave it out"
            )
    names = set(_players(block["instances"]))
    for name in (name for couple in block.get("dependence", []) for name in couple):
        if name not in names:
            yield f"{where}.dependence: {unknown(name, names, 'cause of the experiment')}"
    known = [name for name in block.get("sequences", []) if name in data]
    if isinstance(block["pairs"], list) or known == block.get("sequences"):
        for sequence, pairs in _pairs(block, data).items():
            if len(pairs) < 2:
                yield (
                    f"{where}.pairs: one pair of {sequence}, expected at least 2: a pair is "
                    "diagnosed beside the others. Hint: list more of its pairs, at best all"
                )


def _number_of_pairs(block, data):
    """As far as the sequences are known."""
    if isinstance(block["pairs"], list):
        return len(block["pairs"])
    known = [name for name in block.get("sequences", []) if name in data]
    return sum(len(pairs) for pairs in _pairs({**block, "sequences": known}, data).values())


def _is_registered(pair, block, data):
    if isinstance(block["pairs"], list):
        return pair in block["pairs"]
    sequence, indices = pair["sequence"], (pair["reference"], pair["source"])
    selected = _selection(block).pairs(data[sequence]["scans"])
    return sequence in block.get("sequences", []) and indices in selected


def _instance_inconsistencies(where, block):
    instances = block["instances"]
    ((form, causes),) = instances.items()
    here = f"{where}.instances.{form}"
    if len(causes) > MOST:
        yield (
            f"{here}: {len(causes)} causes, expected at most {MOST}: an instance of M causes is "
            f"2^M settings, here {2 ** len(causes):,}, and each is run. "
            "Hint: leave out causes; what is not named is off"
        )
    for name, levels in causes.items() if form == "grid" else ():
        if isinstance(levels, dict) and levels["stop"] < levels["start"]:
            yield f"{here}.{name}: stop {levels['stop']} is below start"
            return
        expanded = expand_levels(levels)
        if len(expanded) > schema.MOST_LEVELS:
            yield (
                f"{here}.{name}: more than {schema.MOST_LEVELS} levels. "
                "Hint: a larger step, or a smaller range"
            )
            return
        if len(set(expanded)) < len(expanded):
            yield (
                f"{here}.{name}: levels are equal after rounding to 12 decimals. "
                "Hint: a larger step"
            )
            return
    if form == "grid":
        settings = prod(
            len({CAUSES[n].off, *expand_levels(levels)}) for n, levels in causes.items()
        )
        if settings > MOST_SETTINGS:
            yield (
                f"{here}: {settings:,} settings a pair, expected at most {MOST_SETTINGS:,}. "
                "Hint: fewer levels or fewer causes"
            )
    waterfall = block.get("waterfall")
    if waterfall is not None:
        yield from _waterfall_inconsistencies(where, waterfall, form, causes)
    elif form == "grid":
        for figure, what in (("waterfall", "a waterfall plot"), ("drive", "the drive")):
            if figure in block["figures"]:
                yield f"{where}.waterfall: missing; figures asks for {what} of an instance"
    for couple in block.get("dependence", []):
        for name in couple:
            if name not in causes:
                yield (
                    f"{where}.dependence: {unknown(name, causes, 'cause of the experiment')} "
                    "Hint: name it under instances"
                )


def _waterfall_inconsistencies(where, waterfall, form, causes):
    for name in causes:
        if name not in waterfall:
            yield (
                f"{where}.waterfall: missing {name}; the instance needs a value of each cause that "
                f"instances.{form} names"
            )
        elif form == "grid" and waterfall[name] not in expand_levels(causes[name]):
            known = ", ".join(f"{level:.12g}" for level in expand_levels(causes[name]))
            yield (
                f"{where}.waterfall.{name}: {waterfall[name]} is not a level of the "
                f"grid. Hint: its levels are {known}"
            )
    for name in waterfall:
        if name not in causes:
            yield (
                f"{where}.waterfall.{name}: instances.{form} does not name this cause, so it is "
                "off. Hint: leave it out here, or give it levels there"
            )
    if form == "fixed" and set(waterfall) == set(causes) and waterfall != causes:
        yield f"{where}.waterfall: is not the fixed instance"


def unknown(name: object, names: Iterable[str], what: str = "name") -> str:
    """A sentence, with its end."""
    close = difflib.get_close_matches(str(name), [str(known) for known in names], n=1)
    if close:
        return f"unknown {what} '{name}', did you mean '{close[0]}'?"
    return f"unknown {what} '{name}', expected one of {', '.join(map(str, names))}."


# --- the schema -----------------------------------------------------------------------------------


def _coerce(value, schema):
    """The value with the numbers, truth values and nulls that the schema wants, where it has them.

    Strings are read; integral floats are integers where the schema wants integers.
    """
    for branch in schema.get("oneOf", []):
        if {"array": list, "object": dict, "string": str}[branch["type"]] is type(value):
            return _coerce(value, branch)
    if isinstance(value, dict):
        properties, others = schema.get("properties", {}), schema.get("additionalProperties")
        others = others if isinstance(others, dict) else {}
        return {key: _coerce(item, properties.get(key, others)) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_coerce(item, schema.get("items", {})) for item in value]
    kinds = schema.get("type", [])
    kinds = [kinds] if isinstance(kinds, str) else kinds
    if isinstance(value, str) and "string" not in kinds:
        value = _parse(value, kinds)
    if isinstance(value, float) and "integer" in kinds and value.is_integer():
        return int(value)
    return value


def _parse(text, kinds):
    words: dict[str, bool | None] = {"true": True, "false": False} if "boolean" in kinds else {}
    words |= {"null": None, "none": None} if "null" in kinds else {}
    if text.lower() in words:
        return words[text.lower()]
    casts = [int, float] if "integer" in kinds else [float] if "number" in kinds else []
    for cast in casts:
        try:
            return cast(text)
        except ValueError:
            pass
    return text


def _non_finite(value, path=()):
    """(path, number) of every number that is infinite or not a number."""
    if isinstance(value, float) and not isfinite(value):
        yield path, value
    items = enumerate(value) if isinstance(value, list) else ()
    for key, item in value.items() if isinstance(value, dict) else items:
        yield from _non_finite(item, (*path, key))


def _leaves(errors):
    """Errors of the branch that was meant, where the schema offers several."""
    for error in errors:
        if error.validator != "oneOf":
            yield error
            continue
        other = {cause.schema_path[0] for cause in error.context if _is_other_type(cause)}
        meant = [cause for cause in error.context if cause.schema_path[0] not in other]
        yield from _leaves(meant) if meant else [error]


def _is_other_type(cause):
    return cause.validator == "type" and not cause.path


def _describe(error, kinds):
    """Lines that say what is wrong; kinds: kind by name of the estimator."""
    path, value = tuple(error.absolute_path), error.instance
    where = _dotted(path)
    if error.validator == "additionalProperties":
        known = error.schema.get("properties", {})
        return [
            f"{where}: {_unknown_key(key, known, path, kinds)}" for key in value if key not in known
        ]
    if error.validator == "required":
        missing = [key for key in error.validator_value if key not in value]
        return [f"{where}: missing {', '.join(missing)}"]
    if error.validator == "enum":
        return [f"{where}: {unknown(value, error.validator_value)}"]
    if error.validator == "uniqueItems":
        twice = next(item for item in value if value.count(item) > 1)
        return [f"{where}: {error.message}. Hint: keep one {twice!r}"]
    if error.validator == "minItems" and not value:
        return [
            f"{where}: expected at least one entry, found an empty list. "
            "Hint: give one, or leave the key out"
        ]
    if error.validator == "maxProperties":
        return [
            f"{where}: expected one of {', '.join(error.schema['properties'])}, found "
            f"{' and '.join(value)}. "
            "Hint: mappings of several config files are merged; give yours a name of its own, and "
            "`based_on` this one"
        ]
    if _is_entry(value, error.schema):
        return [f"{where}: expected a list, found {value!r}. Hint: {_as_list(path, value)}"]
    meaning = error.schema.get("description")
    if error.validator == "type" and error.validator_value == "object" and not meaning:
        meaning = ", ".join(f"{key}: .." for key in error.schema.get("required", []))
    message = error.message
    if error.validator == "oneOf":
        message = f"{value!r} is none of what it may be"
    return [f"{where}: {message}" + (f" ({meaning})" if meaning else "")]


def _unknown_key(key, known, path, kinds):
    if path[:1] == ("estimators",) and (others := presets.kinds_with(key)):
        return (
            f"'{key}' is an option of the kind{'s' * (len(others) > 1)} {', '.join(others)}, and "
            f"this estimator is of the kind {kinds[path[1]]}. Hint: leave it out, or change `kind`"
        )
    what = "cause" if set(known) == set(CAUSES) else "key"
    return unknown(key, known, what)


def _dotted(path):
    return ".".join(map(str, path)) or "configuration"


def _is_entry(value, schema):
    """Whether a value is what a list may hold that the schema wants, or offers among others."""
    of = {str: {"string"}, int: {"integer", "number"}, float: {"number"}}.get(type(value), set())
    branches = [schema, *schema.get("oneOf", [])]
    return any(branch.get("items", {}).get("type") in of for branch in branches)


def _as_list(path, value):
    """The value as the one entry of a list, as one writes it on the command line."""
    text = f"[{value}]"
    for key in reversed(path[1:]):
        text = f"{{{key}: {text}}}"
    return f"--config '{path[0]}={text}'"
