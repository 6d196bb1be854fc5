"""The JSON schema of the configuration, made from the options and the causes."""

from collections import defaultdict
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from icpshap import options, presets
from icpshap.causes import CAUSES, named
from icpshap.data.layout import ORDERS
from icpshap.data.scenes import SCENES
from icpshap.estimators import KINDS
from icpshap.estimators.perturb import Perturbation
from icpshap.options import REQUIRED, option
from icpshap.selection import MOST_SCANS, Selection

# An end that Python and the editors' JavaScript read alike; a Python $ also ends before a newline.
END = r"$(?!\n)"
KEY = {"type": "string", "pattern": rf"^[a-z][a-z0-9_]*{END}", "maxLength": 64}
TITLE = {"type": "string", "pattern": rf"^[^\x00-\x1f\x7f]*{END}", "maxLength": 100}
NAMES = {"type": "array", "items": {"type": "string"}, "minItems": 1, "uniqueItems": True}
FIGURES = ("summary", "waterfall", "dependence", "interactions", "directions", "pairs", "drive")
MOST_LEVELS = 1000  # of one cause
TILTING_BEAMS = 367_540  # of a full scan of the simulated tilting laser


@dataclass(frozen=True, kw_only=True)
class Archive:
    """Keys of `archive`."""

    url: str = option(
        None,
        "Where the ZIP is; scans are read out of it by Range requests",
        schema={"type": "string", "pattern": "^https?://"},
    )
    path: str = option(
        None, "A ZIP on disk, relative to the working directory; it is used instead of the url"
    )
    bytes: int = option(None, "Size of the ZIP; another size is an error", minimum=1)
    md5: str = option(
        None,
        "MD5 of the ZIP, where published; checked whenever the whole ZIP is at hand",
        schema={"type": "string", "pattern": "^[0-9a-f]{32}$"},
    )
    sha256: str = option(
        None,
        "SHA256 of the ZIP, where published; checked whenever the whole ZIP is at hand",
        schema={"type": "string", "pattern": "^[0-9a-f]{64}$"},
    )


@dataclass(frozen=True, kw_only=True)
class Folder:
    """Keys of `folder`."""

    path: str = option(REQUIRED, "The folder")
    poses: str = option(
        None,
        "The pose file in it, found by name when absent; or register: ICP registers consecutive "
        "scans, and its answers are taken as the truth",
    )
    files: list = option(
        None,
        "The scan files in it, in their order; found by name when absent",
        schema={**NAMES, "minItems": 2},
    )
    columns: list = option(
        None,
        "What the columns of scan files are that do not say so, among them x, y and z; absent: x, "
        "y and z come first. For nuScenes [x, y, z, intensity, ring]",
        schema={**NAMES, "minItems": 3, "maxItems": 1000},
    )
    quaternion: str = option(
        None,
        "Order of the quaternions in a TUM file; absent: xyzw, or what the file or the scans say",
        choices=ORDERS,
    )
    guess: str = option(
        None,
        "With poses: register, where ICP starts: T_reference_source of two consecutive scans as 12 "
        "or 16 numbers, row by row; or a file in the folder with one, or one for each two scans. "
        "Absent: no motion",
        schema={
            "oneOf": [
                {"type": "string", "minLength": 1},
                {"type": "array", "items": {"type": "number"}, "minItems": 12, "maxItems": 16},
            ]
        },
    )


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """Keys of `simulated`."""

    scene: str = option(REQUIRED, "The scene", choices=tuple(SCENES))
    beams: int = option(
        REQUIRED,
        f"Laser beams of a scan, of the tilting laser drawn out of its {TILTING_BEAMS}; a few "
        "return no point, of the sky none",
        minimum=1000,
        maximum=1_000_000,
    )
    rings: int | None = option(
        None,
        "Rings of a spinning scanner, over 45 degrees, with equally many beams each; null: a "
        "tilting laser",
        minimum=16,
        maximum=128,
    )
    range_noise: float | None = option(
        None,
        "Standard deviation of a range; null: 0.01 below and 0.03 above 10 m for the tilting "
        "laser, 0.02 for the spinning scanner",
        unit="m",
        minimum=0,
        maximum=1,
    )
    speed: float = option(
        0.0,
        "Speed ahead while the spinning scanner turns, ten times a second, which distorts a scan; "
        "its pose is that of the middle of the turn",
        unit="m/s",
        minimum=0,
        maximum=50,
    )


def _unsettable(owner):
    """A closed mapping, or null to unset it."""
    return {**options.block(owner), "type": ["object", "null"]}


@dataclass(frozen=True, kw_only=True)
class Sequence:
    """Keys of a sequence."""

    title: str = option(None, "Name in tables and figures; the key when absent", schema=TITLE)
    scans: int = option(
        REQUIRED,
        "Number of scans, numbered from 0. A pose file without a pose for each is an error",
        minimum=2,
        maximum=MOST_SCANS,
    )
    drop_non_finite: bool = option(
        False,
        "Accept scan rows that are not finite, drop them and keep their count; otherwise they are "
        "an error",
    )
    time: str = option(
        None,
        "What scan files call the column that says when each point was measured, which "
        "motion_distortion then uses, in any unit; absent: the scans have no times",
        schema={"type": "string", "minLength": 1, "maxLength": 100},
    )
    archive: dict = option(
        None,
        "A ZIP in the layout of the Challenging data sets, on a server or on disk; null to unset",
        schema=_unsettable(Archive),
    )
    folder: dict = option(
        None,
        "A folder with scans and poses, relative to the working directory; null to unset",
        schema=_unsettable(Folder),
    )
    simulated: dict = option(
        None,
        "Scans of a built-in scene by a simulated laser scanner; null to unset",
        schema=_unsettable(Simulated),
    )


@dataclass(frozen=True, kw_only=True)
class ScanPair:
    """Keys of a pair of scans; ICP moves the source onto the reference."""

    sequence: str = option(REQUIRED, "Key of the sequence")
    reference: int = option(REQUIRED, "Index of the reference scan", minimum=0)
    source: int = option(REQUIRED, "Index of the source scan", minimum=0)


PAIRS = {"type": "array", "items": options.block(ScanPair), "uniqueItems": True}


def _level(cause):
    return {"type": "number", **cause.range.schema}


def _values():
    """One value of each cause that is named."""
    properties = {
        cause.name: {"description": f"{cause.meaning} [{cause.unit or '-'}].", **_level(cause)}
        for cause in named(CAUSES)
    }
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _levels(cause):
    ends = {
        key: {"description": f"{word} level.", **_level(cause)}
        for key, word in (("start", "First"), ("stop", "Last"))
    }
    step = {"description": "Distance of levels.", "type": "number", "exclusiveMinimum": 0}
    return {
        "description": f"{cause.meaning} [{cause.unit or '-'}]: a list of levels, or start, stop "
        "(included) and step.",
        "oneOf": [
            {
                "type": "array",
                "items": _level(cause),
                "minItems": 1,
                "maxItems": MOST_LEVELS,
                "uniqueItems": True,
            },
            {
                "type": "object",
                "additionalProperties": False,
                "required": [*ends, "step"],
                "properties": {**ends, "step": step},
            },
        ],
    }


def _changes():
    """Names of changes, and what they change: the estimator's kind says what options there are."""
    values = _values()
    change = {
        "description": "Options of the estimator, and levels of causes that the experiment names.",
        "type": "object",
        "minProperties": 1,
        "properties": values["properties"],
        "additionalProperties": True,
    }
    names = {"pattern": KEY["pattern"], "maxLength": KEY["maxLength"]}
    return {"type": "object", "propertyNames": names, "additionalProperties": change}


def _instances():
    """The word here, or a mapping with one key."""
    grid = {cause.name: _levels(cause) for cause in named(CAUSES)}
    forms = {
        "grid": {
            "description": "Levels of each cause; every combination is an instance.",
            "type": "object",
            "additionalProperties": False,
            "minProperties": 1,
            "properties": grid,
        },
        "fixed": {"description": "One value of each cause.", "minProperties": 1, **_values()},
        "here": {
            "description": "The levels that are diagnosed of each pair, of the causes that scans "
            "show; and a value of each cause that is told, initial_pose or icp_randomness, if any.",
            **_values(),
        },
    }
    mapping = {
        "type": "object",
        "additionalProperties": False,
        "minProperties": 1,
        "maxProperties": 1,
        "properties": forms,
    }
    return {"oneOf": [{"type": "string", "enum": ["here"]}, mapping]}


def _couples():
    couple = {
        "type": "array",
        "items": {"type": "string", "enum": list(CAUSES)},
        "minItems": 2,
        "maxItems": 2,
        "uniqueItems": True,
    }
    return {"type": "array", "items": couple, "uniqueItems": True}


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Keys of an experiment."""

    estimator: str = option(None, "Name of the estimator")
    estimators: list = option(
        None,
        "Names of several estimators, in place of `estimator`: an experiment <name>_<estimator> of "
        "each, and a figure and a table of all in results/<name>/",
        schema=NAMES,
    )
    sequences: list = option(
        None,
        "The sequences of the experiment; needed unless pairs is a list, which names its own",
        schema=NAMES,
    )
    pairs: list = option(
        REQUIRED,
        "consecutive: scans i and i+1 of every sequence of the experiment; a mapping, which takes "
        "every so many of them; or a list of pairs",
        schema={
            "oneOf": [
                {"type": "string", "enum": ["consecutive"]},
                {**PAIRS, "minItems": 1},
                options.block(Selection),
            ]
        },
    )
    instances: dict = option(
        REQUIRED,
        "The perturbations to explain: a grid of levels, one fixed perturbation, or here, the "
        "levels that are diagnosed of each pair. The causes that it names are the players; what is "
        "not named is off",
        schema=_instances,
    )
    replicates: int = option(
        1,
        "Independent repetitions of the whole experiment with other random numbers; 1 for none",
        minimum=1,
        maximum=1000,
    )
    figures: list = option(
        REQUIRED,
        "Figures to draw",
        schema={
            "type": "array",
            "items": {"type": "string", "enum": list(FIGURES)},
            "uniqueItems": True,
        },
    )
    waterfall: dict = option(
        None,
        "The instance that the waterfall plot and the drive show; of the grid, or the fixed one",
        schema=_values,
    )
    dependence: list = option(
        None,
        "Couples [a, b] of causes of the dependence plots, phi of a coloured by b; those of the "
        "paper's couples that the experiment has when absent",
        schema=_couples,
    )
    what_if: dict = option(
        None,
        "Changes by name, each options of the estimator or levels of causes: the explained "
        "instance is run again with each, and the report says which helps",
        schema=_changes,
    )
    scenes: list = option(
        None,
        "Pairs whose scans and poses are drawn, as a picture and as an interactive page",
        schema=PAIRS,
    )


@dataclass(frozen=True, kw_only=True)
class TopLevel:
    """Keys of the configuration beside its blocks."""

    seed: int = option(
        REQUIRED,
        "Root of every random number. The same seed, config and data give the same bytes",
        minimum=0,
        maximum=2**63 - 1,
    )
    sequences: list = option(REQUIRED, "Which sequences of `data` to use", schema=NAMES)
    run: list = option(REQUIRED, "Which experiments of `experiments` to run", schema=NAMES)
    runs_per_job: int = option(
        REQUIRED,
        "ICP runs of one job, at most; the last of a sequence may have a quarter more. It changes "
        "how the work is cut, never a number",
        minimum=1,
        maximum=10**9,
    )
    stop_at_red: bool = option(
        False,
        "Whether a pair is not registered, and the run stops, where a check of how the settings "
        "fit the scans is red",
    )


def _kind():
    return {
        "kind": {
            "description": "What turns a perturbed pair into pose samples or covariances.",
            "type": "string",
            "enum": list(KINDS),
        }
    }


def _based_on(what):
    return {
        "based_on": {
            "description": f"Another {what} whose values hold for every key not given here.",
            "type": "string",
        }
    }


def _open_to_others(block, what):
    """A block of which keys may come from the one that it is based on."""
    properties = {**_based_on(what), **block["properties"]}
    return {**{key: block[key] for key in block if key != "required"}, "properties": properties}


def estimator(kind: str) -> dict[str, Any]:
    """JSON schema of an estimator of a kind."""
    properties = {**_based_on("estimator"), **_kind()}
    for owner in presets.owners(kind):
        properties |= options.properties(owner)
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _any_estimator():
    """JSON schema of an estimator of which the kind is not known: keys of all kinds.

    A key that kinds do not mean alike has a value that is right for one of them.
    """
    meanings: defaultdict[str, list[dict]] = defaultdict(list)
    for kind in KINDS:
        for name, described in estimator(kind)["properties"].items():
            if described not in meanings[name]:
                meanings[name].append(described)
    properties = {
        name: found[0] if len(found) == 1 else _any_of(found) for name, found in meanings.items()
    }
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _any_of(found):
    words = " Or, by kind: ".join(described["description"] for described in found)
    return {"description": words, "anyOf": found}


def _mapping(description, entry):
    return {
        "description": description,
        "type": "object",
        "propertyNames": KEY,
        "additionalProperties": entry,
    }


EXPERIMENT_KEYS = tuple(options.block(Experiment)["required"])


def configuration() -> dict[str, Any]:
    """JSON schema of the whole configuration; estimators are of any kind."""
    top = options.block(TopLevel)
    blocks = {
        "perturbation": options.block(
            Perturbation,
            "What the causes refer to, for every experiment.",
            required=options.names(Perturbation),
        ),
        "data": _mapping(
            "The sequences, by key. Each is an archive, a folder or simulated. Not called figures "
            "or tables.",
            options.block(Sequence),
        ),
        "estimators": _mapping(
            "The ways from a perturbed pair to an uncertainty, by name.", _any_estimator()
        ),
        "experiments": _mapping(
            "The experiments, by name; results go to results/<name>/. Not called comparison or "
            "so_far.",
            _open_to_others(options.block(Experiment), "experiment"),
        ),
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Configuration of icpshap",
        "description": "Every key that config.yaml, a --configfile or --config may set.",
        **top,
        "required": [*top["required"], *blocks],
        "properties": {**top["properties"], **blocks},
    }


def with_kinds(kinds: Mapping[str, str]) -> dict[str, Any]:
    """The schema with the keys of each estimator's own kind; kinds: by name of the estimator."""
    schema = deepcopy(configuration())
    schema["properties"]["estimators"]["properties"] = {
        name: estimator(kind) for name, kind in kinds.items()
    }
    return schema


def for_editors() -> dict[str, Any]:
    """The schema as editors complete by it: every file may lay a part over config.yaml."""
    return _of_parts(configuration())


def _of_parts(block):
    """A schema without what must be given, but for the entries of lists, which are replaced."""
    if not isinstance(block, dict):
        return block
    return {
        key: value if key == "items" else _of_parts(value)
        for key, value in block.items()
        if key != "required"
    }
