"""What a user gives of one pair, checked: scans, a pose, causes, an estimator, changes.

Options and levels go through the configuration's own checks, so that function, command and workflow
take the same and say the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from icpshap import config, options
from icpshap.causes import CAUSES
from icpshap.data import scans
from icpshap.data.scans import MAXIMUM_COORDINATE, MINIMUM_POINTS
from icpshap.errors import DataError, UserError
from icpshap.estimators import KINDS
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

PRESETS = {"lidar": LIDAR, "paper": PAPER, "released_code": RELEASED_CODE, "robust": ROBUST}
CAUSES_GIVEN = {"sensor_noise": 0.02, "initial_pose": 1.5, "partial_overlap": 0.05}
RIGID = 1e-4  # largest entry of R^T R - I, and of the last row's difference
EXPERIMENT = "pair"
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


def given(causes, estimator, register, what_if, perturbation):
    """The `Given` of the arguments of `explain`. Raises UserError that lists all that is wrong."""
    causes = CAUSES_GIVEN if causes is None else causes
    name, block = _estimator(estimator, register)
    kind = KINDS[block.get("kind", DEFAULT_KIND)]
    if "training" in options.names(kind):
        raise UserError(
            f"estimator: the kind {kind.name} learns from pairs of other sequences, and here is "
            "one pair.\nHint: run it in the workflow (docs/estimators.md), or take another kind."
        )
    function = block.get("register")
    if callable(function):
        block = {**block, "register": PLACEHOLDER}
    if what_if is True:
        what_if = trials(Preset.of(**block), causes)
    checked = _checked(name, block, causes, what_if or {}, perturbation)
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
    changes = checked.experiments[EXPERIMENT].what_if
    parts = checked.what_if.get(EXPERIMENT, {})
    return Given(
        name,
        preset,
        levels,
        checked.perturbation,
        {change: (changes[change], *found[part]) for change, part in parts.items()},
    )


def trials(preset, causes):
    """The changes that are tried where none are named, as far as they change anything.

    More neighbours of a normal, a tighter stop, twice the points, a start half as wide.
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
    if causes.get("initial_pose"):
        found["start_half_as_wide"] = {"initial_pose": causes["initial_pose"] / 4}
    return found


def _estimator(estimator, register):
    """Name and options of what `estimator` and `register` ask for."""
    if isinstance(estimator, Preset):
        name, block = "own options", estimator.options
    elif isinstance(estimator, Mapping):
        block = dict(estimator)
        base = block.pop("based_on", None if "kind" in block else "lidar")
        block = {**(_named(base)[1] if base else {}), **block}
        name = "own options"
    else:
        name, block = _named(estimator)
    if register is None:
        return name, block
    if not callable(register) and not isinstance(register, str):
        raise UserError(
            f"register: a {type(register).__name__}, expected a function of reference, source and "
            "T_initial, or its name as module:function.\n"
            "Hint: register=icpshap.registrations.small_gicp is one."
        )
    taken = option_names("callable")
    block = {key: value for key, value in block.items() if key in taken}
    # Their registration thins the clouds as it likes.
    block |= {"kind": "callable", "register": register, "voxel_size": None}
    return getattr(register, "__name__", str(register)), block


def _named(estimator):
    """Name and options of a preset or a kind."""
    if estimator in PRESETS:
        return estimator, PRESETS[estimator].options
    if estimator in KINDS:
        return estimator, {"kind": estimator}
    raise UserError(
        f"estimator: {config.unknown(estimator, [*PRESETS, *KINDS], 'preset or kind')}\n"
        "Hint: or a mapping of options, such as {'based_on': 'lidar', 'normal_neighbours': 30}."
    )


def _checked(name, block, causes, what_if, perturbation):
    """The config.Config of one pair. Raises UserError that speaks of arguments."""
    if not isinstance(causes, Mapping) or not causes:
        raise UserError(
            f"causes: {causes!r}, expected a level for each cause by its name.\n"
            f"Hint: such as {CAUSES_GIVEN}; known are {', '.join(CAUSES)}."
        )
    estimator = "".join(letter if letter.isalnum() else "_" for letter in name.lower())
    mapping = {
        "seed": 0,
        "sequences": ["pair"],
        "run": [EXPERIMENT],
        "runs_per_job": 1,
        "perturbation": {**options.values(Perturbation()), **(perturbation or {})},
        "data": {"pair": {"scans": 2, "folder": {"path": "."}}},
        "estimators": {estimator: block},
        "experiments": {
            EXPERIMENT: {
                "estimator": estimator,
                "pairs": [{"sequence": "pair", "reference": 0, "source": 1}],
                "instances": {"fixed": dict(causes)},
                "figures": [],
                **({"what_if": {key: dict(value) for key, value in what_if.items()}}),
            }
        },
    }
    try:
        return config.load(mapping)
    except config.ConfigError as error:
        lines = "\n".join(f"  - {_spoken(line, estimator)}" for line in error.errors)
        raise UserError(
            f"{len(error.errors)} argument(s) cannot be used:\n{lines}\n"
            "Hint: docs/configuration.md explains every option and cause."
        ) from None


def _spoken(line, estimator):
    """An error of the configuration as one of the arguments."""
    for key, argument in (
        (f"experiments.{EXPERIMENT}.instances.fixed", "causes"),
        (f"experiments.{EXPERIMENT}.what_if", "what_if"),
        (f"experiments.{EXPERIMENT}.estimator", "estimator"),
        (f"estimators.{estimator}", "estimator"),
    ):
        line = line.replace(key, argument)
    return line


# --- scans and poses ------------------------------------------------------------------------------


def read_scan(path: str | Path, columns: list[str] | None = None) -> np.ndarray:
    """Points (n, 3) [m] of a scan file, in its scanner's frame; its suffix says the format.

    columns: names of all columns of a file that does not name them. Raises DataError.
    """
    return scans.read_scan(path, columns=columns)[0]


def scan(points: Any, what: str) -> np.ndarray:
    """Points (n, 3) [m], float64 in C order, in their scanner's frame. Raises DataError."""
    array = np.asarray(points)
    if array.dtype.kind not in "fiu":
        raise DataError(
            f"{what}: an array of type {array.dtype}, expected numbers.",
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
    array = np.asarray(values, dtype=float)
    if array.shape != (number,) or not np.isfinite(array).all() or array.min() == array.max():
        raise DataError(
            f"source_times: an array of shape {array.shape}, expected ({number},), one finite time "
            "for each source point, not all alike.",
            "leave it out, and the estimator's scan_order counts.",
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
    rotation, last = T[:3, :3], T[3]
    if np.abs(last - [0, 0, 0, 1]).max() > RIGID:
        transposed = np.abs(T[:, 3] - [0, 0, 0, 1]).max() <= RIGID
        raise DataError(
            f"{what}: the last row is {last.tolist()}, expected [0, 0, 0, 1].",
            f"transpose it: {what}.T." if transposed else "matrices are row-major: [R t; 0 1].",
        )
    scale = np.cbrt(np.abs(np.linalg.det(rotation)))
    if np.linalg.det(rotation) < 0:
        raise DataError(
            f"{what}: a reflection (its determinant is {np.linalg.det(rotation):.3g}), expected a "
            "rotation.",
            "two axes are swapped, or one is turned round: check how the matrix is made.",
        )
    gram = rotation.T @ rotation
    if np.abs(gram - np.eye(3)).max() > RIGID:
        scaled = np.abs(gram / scale**2 - np.eye(3)).max() <= RIGID
        raise DataError(
            f"{what}: its 3x3 part is no rotation (R^T R differs from the identity by "
            f"{np.abs(gram - np.eye(3)).max():.2g}, at most {RIGID:g} is allowed"
            f"{f'; it has the scale {scale:.6g}' if scaled else ''}).",
            "divide it by the scale, and bring the scans to the same unit."
            if scaled
            else "write more decimals; a matrix is row-major.",
        )
    return T


def _matrix(values, what):
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise DataError(f"{what}: no array of numbers.", _FORMS) from None
    if array.shape in ((4, 4), (3, 4), (12,), (16,)):
        T = np.eye(4)
        T[: array.size // 4] = array.reshape(-1, 4)
        return T
    if array.shape == (7,):
        return _of_quaternion(array, what)
    raise DataError(f"{what}: an array of shape {array.shape}.", _FORMS)


_FORMS = (
    "T_reference_source is a 4x4 or 3x4 matrix, 16 or 12 numbers row by row, or 7: tx ty tz qx qy "
    "qz qw."
)


def _of_quaternion(numbers, what):
    norm = np.linalg.norm(numbers[3:])
    if not abs(norm - 1) <= RIGID:
        raise DataError(
            f"{what}: a quaternion of norm {norm:.6g}, expected 1 within {RIGID:g}.",
            "seven numbers are tx ty tz qx qy qz qw.",
        )
    from scipy.spatial.transform import Rotation

    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(numbers[3:]).as_matrix()
    T[:3, 3] = numbers[:3]
    return T
