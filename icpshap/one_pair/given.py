"""What a user gives of one pair, checked: scans, a pose, causes, an estimator, changes, a seed.

Options and levels go through the configuration's own checks, so that function, command and workflow
take the same and say the same.
"""

from __future__ import annotations

import logging
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from icpshap import config, options
from icpshap.causes import CAUSES
from icpshap.data import scans
from icpshap.data.poses import check_pose, transform_of
from icpshap.data.scans import MAXIMUM_COORDINATE, MINIMUM_POINTS
from icpshap.errors import DataError, UserError
from icpshap.estimators import KINDS
from icpshap.estimators.callable_registration import called_name, check_arguments
from icpshap.estimators.perturb import Perturbation
from icpshap.presets import (
    DEFAULT_KIND,
    LIDAR,
    PAPER,
    RELEASED_CODE,
    ROBUST,
    Preset,
    option_names,
)
from icpshap.report.what_if import AS_IT_IS

log = logging.getLogger(__name__)

PRESETS = {"lidar": LIDAR, "paper": PAPER, "released_code": RELEASED_CODE, "robust": ROBUST}
CAUSES_GIVEN = {"sensor_noise": 0.02, "initial_pose": 1.5, "partial_overlap": 0.05}
INITIAL = "initial_pose"
SEED = 42  # that of config.yaml
LONGEST_NAME = 80  # characters of a change's name
# What the configuration calls them; what_if's changes are numbered, since their names are free.
EXPERIMENT, ESTIMATOR, CHANGE = "pair", "estimator", "change_{}x"
# A function cannot stand in a configuration; this one does until the checks are over.
PLACEHOLDER = "icpshap.registrations:small_gicp"


@dataclass(frozen=True)
class Given:
    """What is explained: levels by cause, and how; what_if: (changes, levels, preset) by name."""

    name: str
    preset: Preset
    levels: dict[str, float]
    perturbation: Perturbation
    what_if: dict[str, tuple[dict, dict[str, float], Preset]]
    seed: int


def given(
    causes: Mapping[str, float] | None,
    estimator: Any,
    register: Callable | str | None,
    what_if: Mapping | bool | None,
    perturbation: Mapping[str, float] | None,
    seed: int = SEED,
) -> Given:
    """The `Given` of the arguments of `explain`. Raises UserError that lists all that is wrong."""
    if what_if is True:
        as_it_is = given(causes, estimator, register, None, perturbation, seed)
        what_if = trials(as_it_is.preset, as_it_is.levels)
    causes = mapping(CAUSES_GIVEN if causes is None else causes, "causes", CAUSES_GIVEN)
    perturbation = mapping(
        {} if perturbation is None else perturbation, "perturbation", {"overlap_distance": 0.3}
    )
    changes = _changes({} if what_if is None or what_if is False else what_if)
    name, block = _estimator(estimator, register)
    kind = KINDS[block.get("kind", DEFAULT_KIND)]
    if "training" in options.names(kind):
        raise UserError(
            f"estimator: the kind {kind.name} learns from pairs of other sequences, and here is "
            "one pair.\nHint: run it in the workflow, in a clone of icpshap, or take another kind."
        )
    function = block.get("register")
    if callable(function):
        check_arguments(f"register: {name}", function)
        block = {**block, "register": PLACEHOLDER}
    checked = _checked(block, causes, changes, perturbation, seed)
    found = {}
    for part in checked.planned:
        experiment = checked.experiments[part]
        preset = checked.estimators[experiment.estimator]
        if callable(function):
            kind = replace(preset.estimator.kind, register=function)
            preset = replace(preset, estimator=replace(preset.estimator, kind=kind))
        levels = {cause: levels[0] for cause, levels in experiment.levels.items()}
        found[part] = levels, preset
    levels, preset = found[EXPERIMENT]
    if all(level == CAUSES[cause].off for cause, level in levels.items()):
        raise UserError(
            f"causes: all are off ({', '.join(f'{c}: {x:g}' for c, x in levels.items())}).\n"
            "Hint: give one of them a level."
        )
    typed = checked.experiments[EXPERIMENT].what_if
    parts = checked.what_if.get(EXPERIMENT, {})
    what_if = {
        change: (typed[key], *found[parts[key]]) for key, (change, _) in _keyed(changes).items()
    }
    return Given(name, preset, levels, checked.perturbation, what_if, checked.seed)


def trials(preset: Preset, causes: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """The changes that are tried where none are named, as far as they change anything.

    More neighbours of a normal, a tighter stop, twice the points, a closer start: half as wide, or
    as that of the clean setting, which is as close as a start is without a cause.
    """
    known, found = preset.options, {}
    if (neighbours := known.get("normal_neighbours")) and known["metric"] == "point_to_plane":
        limit = options.properties(KINDS[known["kind"]])["normal_neighbours"]["maximum"]
        more = min(max(20, round(1.5 * neighbours)), limit)
        found["more_neighbours"] = {"normal_neighbours": more}
    if (rotation := known.get("stop_rotation")) and (translation := known["stop_translation"]):
        tight = {"stop_rotation": rotation / 10, "stop_translation": translation / 10}
        found["tight_stop"] = tight
    probability = known["subsampling_probability"]
    # All points would leave nothing that varies from run to run.
    if (more := min(2 * probability, (1 + probability) / 2)) < 1:
        found["twice_the_points" if more == 2 * probability else "more_points"] = {
            "subsampling_probability": more
        }
    off = CAUSES[INITIAL].off
    if (level := causes.get(INITIAL, off)) > off and "initial_pose_scaling" in known:
        # s scales the covariance; in the released code the standard deviation.
        of_deviation = known["initial_pose_scaling"] == "standard_deviation"
        closer = max(level / (2 if of_deviation else 4), off)
        if closer > off or any(causes[name] != CAUSES[name].off for name in {*causes} - {INITIAL}):
            found["closer_start"] = {INITIAL: closer}
    return found


def mapping(values: object, what: str, example: object) -> dict[str, Any]:
    """A mapping as a dict, numpy's scalars in it as Python's. Raises UserError for anything else.

    what: the argument's name; example: what it looks like.
    """
    if not isinstance(values, Mapping):
        raise UserError(
            f"{what}: {values!r}, expected a mapping, values by name.\nHint: such as {example}."
        )
    # Copies, since the configuration knows no numpy scalars.
    return {
        key: value.item() if isinstance(value, np.generic) else value
        for key, value in values.items()
    }


def _changes(what_if):
    """The changes by name, with names that can be told from one another and printed."""
    example = {"more neighbours": {"normal_neighbours": 30}}
    changes = {
        name: mapping(change, f"what_if: {name}", example["more neighbours"])
        for name, change in mapping(what_if, "what_if", f"{example}, or True").items()
    }
    for name, change in changes.items():
        printable = isinstance(name, str) and name.strip() and name.isprintable()
        if not printable or len(name) > LONGEST_NAME or name == AS_IT_IS:
            raise UserError(
                f"what_if: the name {name!r}, expected up to {LONGEST_NAME} printable characters, "
                f"and not {AS_IT_IS!r}.\nHint: such as 'more neighbours'."
            )
        if "based_on" in change:
            raise UserError(
                f"what_if: {name}: based_on, expected options and levels that change.\n"
                "Hint: explain the pair with another estimator instead."
            )
    return changes


def _keyed(changes):
    """(name, change) of each change, by the key that the configuration has for it."""
    return {CHANGE.format(place): change for place, change in enumerate(changes.items())}


def _estimator(estimator, register):
    """Name and options of what `estimator` and `register` ask for."""
    name, base, own = _asked(estimator)
    if register is None:
        return name, {**base, **own}
    if not callable(register) and not isinstance(register, str):
        raise UserError(
            f"register: of the type {type(register).__name__}, expected a function of reference, "
            "source and T_initial, or its name as module:function.\n"
            "Hint: register=icpshap.registrations.small_gicp is one."
        )
    if (kind := {**base, **own}.get("kind", DEFAULT_KIND)) not in (DEFAULT_KIND, "callable"):
        raise UserError(
            f"register: the estimator is of the kind {kind}, which registers itself.\n"
            f"Hint: leave one of them out, or give one of {', '.join(PRESETS)} as estimator."
        )
    if "register" in own:
        raise UserError(
            f"register: given twice, the estimator has {called_name(own['register'])}.\n"
            "Hint: leave one of them out."
        )
    taken = option_names("callable")
    base = {key: value for key, value in base.items() if key in taken}
    # Their registration thins the clouds as it likes.
    block = {**base, "voxel_size": None, **own, "kind": "callable", "register": register}
    return called_name(register), block


def _asked(estimator):
    """Name of an estimator, the options that it begins from, and those named one by one."""
    if isinstance(estimator, Preset):
        return "own options", estimator.options, {}
    if not isinstance(estimator, Mapping):
        return estimator, _named(estimator), {}
    own = mapping(estimator, "estimator", None)
    base = own.pop("based_on", None if "kind" in own else "lidar")
    if "kind" in own:
        _named(own["kind"], KINDS)
    return "own options", {} if base is None else _named(base), own


def _named(name, known=(*PRESETS, *KINDS)):
    """Options of a preset or a kind. Raises UserError for a name that is not known."""
    if not isinstance(name, str) or name not in known:
        raise UserError(
            f"estimator: {config.unknown(name, list(known), 'preset or kind')}\n"
            "Hint: or a mapping of options, such as {'based_on': 'lidar', 'normal_neighbours': 30}."
        )
    return PRESETS[name].options if name in PRESETS else {"kind": name}


def _checked(block, causes, changes, perturbation, seed):
    """The config.Config of one pair. Raises UserError that speaks of arguments."""
    if not causes:
        raise UserError(
            "causes: none, expected a level for each cause by its name.\n"
            f"Hint: such as {CAUSES_GIVEN}; known are {', '.join(CAUSES)}."
        )
    mapping = {
        "seed": seed.item() if isinstance(seed, np.generic) else seed,
        "sequences": ["pair"],
        "run": [EXPERIMENT],
        "runs_per_job": 1,
        "perturbation": {**options.values(Perturbation()), **perturbation},
        "data": {"pair": {"scans": 2, "folder": {"path": "."}}},
        "estimators": {ESTIMATOR: block},
        "experiments": {
            EXPERIMENT: {
                "estimator": ESTIMATOR,
                "pairs": [{"sequence": "pair", "reference": 0, "source": 1}],
                "instances": {"fixed": causes},
                "figures": [],
                "what_if": {key: change for key, (_, change) in _keyed(changes).items()},
            }
        },
    }
    try:
        return config.load(mapping)
    except config.ConfigError as error:
        lines = "\n".join(f"  - {_spoken(line, changes)}" for line in error.errors)
        raise UserError(
            f"{len(error.errors)} argument(s) cannot be used:\n{lines}\n"
            "Hint: options are those of icpshap.LIDAR.options, and of the estimator's kind; causes "
            f"{', '.join(CAUSES)}."
        ) from None


def _spoken(line, changes):
    """An error of the configuration as one of the arguments."""
    for key, argument in (
        (f"experiments.{EXPERIMENT}.instances.fixed", "causes"),
        (f"experiments.{EXPERIMENT}.what_if", "what_if"),
        (f"experiments.{EXPERIMENT}.estimator", "estimator"),
        (f"estimators.{ESTIMATOR}", "estimator"),
        *((f"{EXPERIMENT}_{key}", change) for key, (change, _) in _keyed(changes).items()),
        *((key, change) for key, (change, _) in _keyed(changes).items()),
    ):
        line = line.replace(key, argument)
    return line


# --- numbers --------------------------------------------------------------------------------------


def whole(value: object, what: str, least: int) -> int:
    """An integer. Raises UserError for what is none, or less than `least`."""
    try:
        number: int | None = operator.index(value)  # type: ignore[arg-type]  # may be anything
    except TypeError:
        number = None
    if number is None or isinstance(value, bool | np.bool_) or number < least:
        raise UserError(
            f"{what}: {value!r}, expected a whole number of at least {least}.\n"
            f"Hint: such as {max(least, 1)}."
        )
    return number


def named_pair(name: str, indices: tuple[int, int]) -> tuple[str, int, int]:
    """Sequence, reference and source that random numbers are drawn for. Raises UserError."""
    if not isinstance(name, str):
        raise UserError(f"name: {name!r}, expected a text.\nHint: such as 'apartment'.")
    if not isinstance(indices, Sequence) or isinstance(indices, str) or len(indices) != 2:
        raise UserError(
            f"indices: {indices!r}, expected two whole numbers, of reference and source.\n"
            "Hint: such as (0, 1)."
        )
    reference, source = (whole(index, "indices", 0) for index in indices)
    return name, reference, source


# --- scans and poses ------------------------------------------------------------------------------


def read_scan(
    path: str | Path, columns: list[str] | None = None, drop_non_finite: bool = False
) -> np.ndarray:
    """Points (n, 3) [m] of a scan file, in its scanner's frame; its suffix says the format.

    columns: names of all columns of a file that does not name them; drop_non_finite: whether points
    that are not finite, as clouds in rows and columns have, are left out, with a warning in the log
    that counts them; else they are an error. Raises DataError.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "scan.xyz"
    ...     _ = path.write_text("1 2 3\\n4 5 6\\n")
    ...     read_scan(path)
    array([[1., 2., 3.],
           [4., 5., 6.]])
    """
    points, dropped = scans.read_scan(path, drop_non_finite, columns)
    if dropped:
        log.warning("%s: %d points that are not finite are left out", path, dropped)
    return points


def scan(points: Any, what: str) -> np.ndarray:
    """Points (n, 3) [m], float64 in C order, in their scanner's frame. Raises DataError."""
    array = _numbers(
        points,
        what,
        "give an array (n, 3) of x, y, z in metres; icpshap.read_scan reads one from a file.",
    )
    if array.ndim != 2 or array.shape[1] != 3:
        raise DataError(
            f"{what}: an array of shape {array.shape}, expected (n, 3).", _reshaped(array.shape)
        )
    array = np.ascontiguousarray(array, dtype=float)
    finite = np.isfinite(array).all(axis=1)
    if not finite.all():
        raise DataError(
            f"{what}: {np.count_nonzero(~finite)} of {len(array)} points are not finite, the first "
            f"in row {np.argmin(finite)}.",
            "leave them out: points[np.isfinite(points).all(axis=1)].",
        )
    if len(array) < MINIMUM_POINTS:
        raise DataError(
            f"{what}: {len(array)} points, expected at least {MINIMUM_POINTS}.",
            "give the whole scan; the estimator thins it.",
        )
    if (farthest := np.abs(array).max()) > MAXIMUM_COORDINATE:
        raise DataError(
            f"{what}: a coordinate of {farthest:.6g}, expected at most {MAXIMUM_COORDINATE:g} m.",
            "a scan is in metres and in the scanner's own frame: check the units, subtract the "
            "origin of a map.",
        )
    return array


def _numbers(values, what, hint, kinds="fiu"):
    """An array of what is array-like, of real numbers. Raises DataError.

    kinds: letters of the types that are taken, as numpy has them.
    """
    if np.ma.is_masked(values):
        raise DataError(
            f"{what}: {np.ma.count_masked(values)} entries are masked, expected none.",
            "leave out what is masked: a.data[~np.ma.getmaskarray(a).any(axis=1)].",
        )
    try:
        array = np.asarray(values)
    except (TypeError, ValueError, RuntimeError) as error:  # as of a tensor that lies elsewhere
        raise DataError(
            f"{what}: no array of numbers ({' '.join(str(error).split())}).", hint
        ) from None
    if array.dtype.names:
        hint = f"take its columns: np.stack([a[name] for name in {array.dtype.names[:3]}], axis=1)."
    if array.dtype.kind not in kinds:
        raise DataError(f"{what}: an array of type {array.dtype}, expected numbers.", hint)
    return array


def _reshaped(shape):
    if len(shape) == 2 and shape[0] == 3:
        return "points are rows: points.T."
    if len(shape) == 2 and shape[1] > 3:
        return "take x, y and z: points[:, :3]."
    return "points are rows of x, y and z in metres."


def times(values: Any, number: int) -> np.ndarray | None:
    """When each source point was measured (m,), in any unit; None of None. Raises DataError."""
    if values is None:
        return None
    hint = "leave it out, and the estimator's scan_order counts."
    array = _numbers(values, "source_times", hint, "fiumM").astype(float)
    if array.shape != (number,) or not np.isfinite(array).all() or array.min() == array.max():
        raise DataError(
            f"source_times: an array of shape {array.shape}, expected ({number},), one finite time "
            "for each source point, not all alike.",
            hint,
        )
    return array


def transform(values: Any, what: str = "T") -> np.ndarray:
    """T_reference_source (4, 4) of a matrix, of its 16 or 12 numbers row by row, or of 7.

    Seven are a translation [m] and a quaternion, tx ty tz qx qy qz qw. Raises DataError if it is no
    rigid transformation; of an inverse one nobody can tell before the scans are there.
    """
    T = _matrix(values, what)
    if not np.isfinite(T).all():
        raise DataError(f"{what}: entries that are not finite.", "give 4x4 finite numbers.")
    check_pose(what, T)
    return T


def _matrix(values, what):
    array = _numbers(values, what, _FORMS)
    if array.shape in ((4, 4), (3, 4), (12,), (16,)):
        T = np.eye(4)
        T[: array.size // 4] = array.reshape(-1, 4)
        return T
    if array.shape == (7,):
        return transform_of(array, what)
    raise DataError(f"{what}: an array of shape {array.shape}.", _FORMS)


_FORMS = (
    "T_reference_source is a 4x4 or 3x4 matrix, 16 or 12 numbers row by row, or 7: tx ty tz qx qy "
    "qz qw."
)
