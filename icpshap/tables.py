"""The parquet files: columns, types and units, and how they are read and written.

Columns follow from the causes that an experiment names. A file carries, beside its columns, only
what decides its numbers (causes, plan, digests of the data), so that the same inputs give the same
bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow as pa

from icpshap import causes as registry
from icpshap import storage
from icpshap.errors import UserError

if TYPE_CHECKING:
    from icpshap.causes.cause import Cause


PAIR = ["sequence", "reference", "source"]
INITIAL_XI = [f"initial_xi_{k}" for k in range(6)]
XI = [f"xi_{k}" for k in range(6)]
TRANSFORM = [f"T_{row}{column}" for row in range(4) for column in range(4)]
COVARIANCE = [f"covariance_{a}{b}" for a in range(6) for b in range(a, 6)]


class TableError(UserError):
    """A file or a frame does not have the columns of its table."""


@dataclass(frozen=True)
class Column:
    """A column: its name, its Arrow type, its unit ('' for none) and what it holds."""

    name: str
    type: str
    unit: str
    description: str


def _columns(names, type_, units, description):
    units = [units] * len(names) if isinstance(units, str) else units
    return [Column(n, type_, unit, description) for n, unit in zip(names, units, strict=True)]


_XI_UNITS = ["rad"] * 3 + ["m"] * 3
_COVARIANCE_UNITS = [
    ("rad^2" if b < 3 else "rad m" if a < 3 else "m^2") for a in range(6) for b in range(a, 6)
]
_INDICES = [
    Column("reference", "int32", "", "index of the reference scan"),
    Column("source", "int32", "", "index of the source scan, which ICP moves"),
]
_PAIR = [Column("sequence", "string", "", "key of the sequence"), *_INDICES]
# The unit of f and of all that is shared out of it: nats, m or rad, as the divergence says.
_F = "f"
_NULL = [
    Column("null_mean", "float64", _F, "mean of f between independent samples of one distribution"),
    Column("null_95", "float64", _F, "95 % quantile of f between such samples"),
]
_W = "share of runs that failed or ended in a wrong basin; NaN where there is no basin"
_SUCCESS = "share of all runs within 0.1 m and 2 deg of the true pose,"
_FAR = "sigma points that ended over 0.1 m or 2 deg from the first"
_WORTH = "independent samples that runs, or the states of a chain, are worth"
_REASON = Column("reason", "string", "", "why the pair was not registered; empty if it was")
_REMARKS = [
    Column("warning", "string", "", "what makes these numbers doubtful; empty if nothing"),
    _REASON,
]
_REPLICATE = Column("replicate", "int32", "", "independent repetition")
_AGAIN = Column("again", "bool", "", "the second clean sample, with draws of its own")
_RUNS = Column("n_runs", "int32", "", "registrations that were run")
_NOISE_DRAW = Column("noise_draw", "int32", "", "index of the noise draw")
_POSE = [
    *_columns(XI, "float64", _XI_UNITS, "pose error log(inv(T_gt) T_icp)"),
    *_columns(TRANSFORM, "float64", "", "entry of T_reference_source, translation in m"),
]
_STATUS = "ok, max_iterations, too_few_links or degenerate; or what a callable did in the place of "
_STATUS += "returning a pose, in words"
_DESCRIPTOR = [
    *_columns([f"mean_{axis}" for axis in "xyz"], "float64", "m", "mean of the source points"),
    *_columns(
        [f"spread_{axes}" for axes in ("xx", "xy", "xz", "yy", "yz", "zz")],
        "float64",
        "m^2",
        "entry of the covariance of the source points",
    ),
    *_columns(
        [f"normals_{direction}" for direction in range(13)],
        "float64",
        "",
        "share of points in cells whose normal is nearest one of 13 directions",
    ),
    *_columns(
        [f"shape_{name}" for name in ("linear", "planar", "scattered")],
        "float64",
        "",
        "mean shape of the cells, by the eigenvalues of their points' covariance",
    ),
    *_columns(
        [f"thickness_{quartile}" for quartile in (1, 2, 3)],
        "float64",
        "m",
        "quartile of the cells' thickness, the smallest standard deviation of their points",
    ),
    Column("log_cells", "float64", "", "logarithm of the number of cells"),
    *_columns(
        ["log_source_points", "log_reference_points"],
        "float64",
        "",
        "logarithm of the number of points in them",
    ),
    *_columns(
        ["shared_source_points", "shared_reference_points"],
        "float64",
        "",
        "share of all points of the scan that these are",
    ),
]
DESCRIPTOR = [column.name for column in _DESCRIPTOR]
_END = [
    Column("iterations", "int32", "", "ICP iterations"),
    Column("status", "string", "", _STATUS),
    Column("rmse", "float64", "m", "root mean square residual of the kept links"),
    Column("inlier_ratio", "float64", "", "share of the links that were kept"),
]


_PLAYED = [
    Column("played_reference", "int32", "", "reference of the pair played on; -1 of no game"),
    Column("played_source", "int32", "", "source of it: the most usual other pair, or this one"),
]
PLAYED = [column.name for column in _PLAYED]
NO_PAIR = -1


def _values(causes):
    return [Column(c.name, "float64", c.unit, f"{c.title} {c.symbol}") for c in causes]


def _estimate(name, meaning, unit=_F):
    """A number that is shared out of the runs, with its 95 % interval."""
    return [
        Column(name, "float64", unit, meaning),
        Column(f"{name}_low", "float64", unit, "lower end of its 95 % interval"),
        Column(f"{name}_high", "float64", unit, "upper end of its 95 % interval"),
    ]


def _variants(name):
    """The same number, had runs, floor or the sensor's own noise been treated otherwise."""
    own = "the sensor's own noise, sensor_sigma; NaN where the spread does not hold it"
    return [
        Column(f"{name}_all", "float64", _F, "with every run kept that did not fail"),
        Column(f"{name}_right_basin", "float64", _F, "without the runs in a wrong basin"),
        Column(f"{name}_floor_tenfold", "float64", _F, "with ten times the covariance floor"),
        Column(f"{name}_floor_tenth", "float64", _F, "with a tenth of the covariance floor"),
        Column(f"{name}_sensor_sigma_twice", "float64", _F, f"with twice {own}"),
        Column(f"{name}_sensor_sigma_half", "float64", _F, f"with half of {own}"),
    ]


def _shapley(cause):
    name = f"phi_{cause.name}"
    ratio = "variance over whole noise draws divided by the one over runs; NaN with one noise draw"
    return [
        *_estimate(name, f"Shapley value of {cause.title}: its part of f"),
        Column(f"{name}_significant", "bool", "", "its interval does not contain 0"),
        Column(f"{name}_draw_variance_ratio", "float64", "", ratio),
        *_variants(name),
    ]


def _removals(causes):
    return [
        column
        for cause in causes
        for column in _estimate(f"removal_{cause.name}", f"what f falls by without {cause.title}")
    ]


def _wrong_basins(causes):
    """W of clean setting and instance, and what each cause contributes to it."""
    lacking = "fewer than half of the runs of one of its settings lie together"
    return [
        Column("clean_success_rate", "float64", "", f"{_SUCCESS} of the clean setting"),
        Column("success_rate", "float64", "", f"{_SUCCESS} with all causes on"),
        *_estimate("clean_wrong_basin_share", "W of the clean setting", ""),
        *_estimate("wrong_basin_share", f"W: {_W}", ""),
        *(
            column
            for cause in causes
            for column in _estimate(
                f"wrong_basin_{cause.name}", f"Shapley value of {cause.title}: its part of W", ""
            )
        ),
        *(
            column
            for cause in causes
            for column in _estimate(
                f"wrong_basin_removal_{cause.name}", f"what W falls by without {cause.title}", ""
            )
        ),
        Column("no_basin", "bool", "", lacking),
    ]


def _shrinking(causes):
    """Whether the spread gets smaller."""
    half = "half the log determinant of the covariance less that of the clean one"
    return [
        *_estimate("entropy_difference", half, "nats"),
        *(
            column
            for c in causes
            for column in _estimate(
                f"entropy_difference_{c.name}", f"Shapley value of {c.title}: its part", "nats"
            )
        ),
        Column("shrinks", "bool", "", "the interval of the entropy difference lies below 0"),
        *(
            Column(f"narrows_{c.name}", "bool", "", f"that of the part of {c.title} does")
            for c in causes
        ),
        *(
            Column(f"{clean}{kind}_rmse", "float64", unit, f"{kind} RMSE {of}")
            for kind, unit in (("translation", "m"), ("rotation", "rad"))
            for clean, of in (("clean_", "of the clean setting"), ("", "of the instance"))
        ),
    ]


def _scans(causes):
    return [
        Column("scan", "int32", "", "index of the scan"),
        *_columns(["x", "y", "z"], "float64", "m", "coordinate in the scanner's frame"),
    ]


def _timed_scans(causes):
    return [
        *_scans(causes),
        Column("time", "float64", "", "when the point was measured, as the file says it"),
    ]


def _poses(causes):
    return [
        Column("scan", "int32", "", "index of the scan"),
        *_columns(TRANSFORM, "float64", "", "entry of T_global_scan, translation in m"),
    ]


def _registrations(causes):
    return [
        *_INDICES,
        *_columns(TRANSFORM, "float64", "", "entry of T_reference_source, in m"),
        Column("iterations", "int32", "", "iterations of ICP, of all its stages"),
        Column("rmse", "float64", "m", "root mean square of the kept links"),
        Column("overlap", "float64", "", "share of source points near the reference"),
    ]


def _overlaps(causes):
    return [
        *_INDICES,
        Column("overlapping", "bool", "", "a reference point is near this source point"),
    ]


def _pairs(causes):
    return [
        *_PAIR,
        Column("reference_points", "int64", "", "points of the raw reference scan"),
        Column("source_points", "int64", "", "points of the raw source scan"),
        Column("overlap", "float64", "", "overlap ratio O at the true pose"),
        Column(
            "characteristic_length",
            "float64",
            "m",
            "root mean square distance of the overlapping source points beyond the chain's minimum "
            "range from their centroid",
        ),
        *_columns(TRANSFORM, "float64", "", "entry of the true T_reference_source, in m"),
        Column(
            "median_distance",
            "float64",
            "m",
            "median distance of source points to the reference at the true pose",
        ),
        Column("registered", "bool", "", "whether the pair is registered"),
        Column("reason", "string", "", "why the pair is not registered"),
        Column("warning", "string", "", "why the true pose looks wrong"),
    ]


def _runs(causes):
    return [
        *_INDICES,
        *_values(causes),
        _REPLICATE,
        _AGAIN,
        Column("run", "int32", "", "index of the run"),
        _NOISE_DRAW,
        Column("weight", "float64", "", "relative weight of the sample, with mean 1"),
        *_columns(INITIAL_XI, "float64", _XI_UNITS, "drawn error of the initial pose"),
        *_POSE,
        *_END,
    ]


def _estimates(causes):
    return [
        *_INDICES,
        *_values(causes),
        _REPLICATE,
        _AGAIN,
        _NOISE_DRAW,
        *_POSE,
        *_columns(
            COVARIANCE,
            "float64",
            _COVARIANCE_UNITS,
            "entry of the covariance of xi in T_reference_source exp(xi), rotation first",
        ),
        *_END,
        Column("n_far", "int32", "", _FAR),
    ]


def _fit_numbers(causes):
    """What `fit.measure` finds of a pair."""

    def number(name, unit, description):
        return Column(name, "float64", unit, description)

    return [
        *_PAIR,
        number("minimum_range", "m", "the option"),
        number("voxel_size", "m", "the option; NaN for none"),
        number("subsampling_probability", "", "the option"),
        number("stop_rotation", "rad", "the option; NaN where the estimator has none"),
        number("neighbours", "", "of a normal; NaN where the estimator has none, as what follows"),
        number("normal_radius", "m", "median radius of the neighbourhoods that give normals"),
        number("line_share", "", "share of them that lie on a line"),
        number("ring_share", "", "share of them on a line as the scanner sees them: on one ring"),
        number("mending_voxel", "m", "voxel side with which few would; NaN for none"),
        number("mending_neighbours", "", "and neighbours; NaN where nothing mends it, or needs to"),
        number("largest_noise", "m", "largest level of the sensor noise; NaN where it is a factor"),
        number("source_points", "", "of a run with all causes at their largest, in the mean"),
        number("reference_points", "", "that a clean run is registered on"),
        number("overlap", "", "overlap ratio O = N / |P1|"),
        number("overlap_distance", "m", "the option"),
        number("matched_distance", "m", "within which three quarters of what both scans see lie"),
        number("duplicate_share", "", "share of points that lie where another one does"),
        number("nearest_return", "m", "range of the nearest return of both scans"),
        number("typical_range", "m", "median range of both scans"),
        number("removed_share", "", "share of the points within the minimum range"),
        number("motion", "m", "length of the true translation"),
        number("median_distance", "m", "of source points from the reference at the true pose"),
        Column("better_pose", "string", "", "the motion that fits better than it; empty for none"),
    ]


def _diagnosis(causes):
    """What `diagnosis.table` says of a pair; of causes it knows those that the scans show."""

    def number(name, unit, description):
        return Column(name, "float64", unit, description)

    vector = "weakest direction in the reference's axes about the overlapping points' centroid"
    seen = registry.players(registry.shown(), {})
    return [
        *_PAIR,
        Column("against", "string", "", "what is healthy: other pairs, data sheet, nothing"),
        Column("healthy_pairs", "int32", "", "number of the other pairs"),
        Column("healthiest_reference", "int32", "", "the most usual of them, -1 for none"),
        Column("healthiest_source", "int32", "", "on which the levels of the causes were found"),
        number("plane_residual", "m", "median distance of neighbours from their plane"),
        number("overlap", "", "overlap ratio N / |P1| in the pose at hand"),
        number("reference_points", "", "of the reference beyond the minimum range"),
        number("weakest_information", "", "share of the weakest direction in the information"),
        Column("weakest", "string", "", "that direction in words"),
        *_columns([f"vector_{k}" for k in range(6)], "float64", "", f"{vector}, rotation by L"),
        number("length", "m", "L, root mean square distance of these points from it"),
        *(number(f"level_{c.name}", c.unit, f"{c.title} that was found; 0 for none") for c in seen),
        *(
            number(f"z_{c.name}", "", f"of what shows {c.title}, in deviations of healthy pairs")
            for c in seen
        ),
        *(number(f"probability_{c.name}", "", f"that {c.title} is there") for c in seen),
        number("probability_nothing", "", "that none of them is"),
        Column("verdict", "string", "", "found, nothing, undecided or unknown"),
        Column("causes", "string", "", "those found, or the two that cannot be told apart"),
        number("confidence", "", "probability of the verdict"),
    ]


def _instances(causes):
    """The level of each cause that is explained of a pair; off where there is none."""
    return [
        *_PAIR,
        *_PLAYED,
        *_values(causes),
        Column("reason", "string", "", "why no game is played; empty if one is"),
    ]


def _fit(causes):
    return [
        *_PAIR,
        Column("check", "string", "", "name of the check"),
        Column("value", "float64", "unit", "the number"),
        Column("unit", "string", "", "its unit; - for none"),
        Column("expected", "string", "", "what is right"),
        Column("grade", "string", "", "red: breaks an answer; remark: colours it; fits"),
        Column("sentence", "string", "", "what was found"),
        Column("remedy", "string", "", "the change that mends it, not tried; empty where it fits"),
    ]


def _descriptors(causes):
    return [
        *_PAIR,
        *_values(causes),
        _REPLICATE,
        *_DESCRIPTOR,
        *_columns(
            COVARIANCE,
            "float64",
            _COVARIANCE_UNITS,
            "entry of the covariance of the setting's runs, with the floor, rotation first",
        ),
    ]


def _setting(causes):
    """Which setting of which pair a row is about."""
    return [*_PAIR, _REPLICATE, *_values(causes), _AGAIN]


def _uncertainty(causes):
    return [
        *_setting(causes),
        *_estimate("f", "uncertainty: the divergence from the clean setting"),
        Column("f_draw_variance_ratio", "float64", "", "as that of phi in the shap table"),
        Column("kl", "float64", "nats", "KL(clean, perturbed), without bias correction"),
        *_NULL,
        _RUNS,
        Column("n_failed", "int32", "", "runs whose status is neither ok nor max_iterations"),
        Column("n_wrong_basin", "int32", "", "runs in a wrong basin"),
        Column("n_far", "int32", "", f"{_FAR}, in the draw with most"),
        *_estimate("wrong_basin_share", f"W: {_W}", ""),
        Column("no_basin", "bool", "", "fewer than half of its runs lie together"),
        Column("n_used", "int32", "", "runs that f is computed from"),
        Column("n_effective", "float64", "", f"{_WORTH}; NaN where that is not known"),
        Column("logdet", "float64", "", "log determinant of the covariance [rad, m], with floor"),
        Column("condition", "float64", "", "its condition number, rad and m counted alike"),
        Column(
            "smallest_standard_deviation",
            "float64",
            "rad or m",
            "smallest standard deviation over all directions, rad and m counted alike",
        ),
        Column(
            "floor_share", "float64", "", "largest share of the floor in a direction's variance"
        ),
        Column(
            "memory",
            "float64",
            "",
            "largest share of a pose component's variance that is linear in the initial pose; "
            "near 0 where ICP converged",
        ),
        Column("mean_translation_error", "float64", "m", "mean distance to the true translation"),
        Column("mean_rotation_error", "float64", "rad", "mean angle to the true rotation"),
        Column("translation_rmse", "float64", "m", "root mean square of that distance"),
        Column("rotation_rmse", "float64", "rad", "root mean square of that angle"),
        Column("success_rate", "float64", "", "share of all runs within 0.1 m and 2 degrees"),
        *_REMARKS,
    ]


def _covariances(causes):
    return [
        *_setting(causes),
        _RUNS,
        Column("n_used", "int32", "", "runs that it is the covariance of, those of f"),
        *_columns(TRANSFORM, "float64", "", "entry of the true T_reference_source, in m"),
        *_columns(
            COVARIANCE,
            "float64",
            _COVARIANCE_UNITS,
            "entry of the covariance of xi in T_reference_source exp(xi), rotation first, in the "
            "frame of the source, without the covariance floor; NaN of too few runs",
        ),
        _REASON,
    ]


def _shap(causes):
    return [
        *_PAIR,
        Column("instance", "int32", "", "number of the instance"),
        *_values(causes),
        Column("base_value", "float64", _F, "f of the clean setting"),
        *_estimate("f", "uncertainty of the instance: the divergence from the clean setting"),
        *_variants("f"),
        *(column for cause in causes for column in _shapley(cause)),
        *(
            column
            for a, b in combinations(causes, 2)
            for column in _estimate(f"interaction_{a.name}_{b.name}", "Shapley interaction index")
        ),
        *_removals(causes),
        *_wrong_basins(causes),
        *_shrinking(causes),
        Column(
            "regression_difference",
            "float64",
            "",
            "largest difference to the regression of Algorithm 1, relative to the largest |phi|",
        ),
        Column("f_again", "float64", _F, "f between the two clean samples of the pair"),
        *_NULL,
        Column("n_runs", "int32", "", "runs of a setting"),
        Column("n_used", "int32", "", "runs of a setting that the values are computed from"),
        Column("n_effective", "float64", "", f"{_WORTH}, in the setting that has least"),
        Column("n_failed", "int32", "", "runs that failed in a setting of the instance"),
        Column("n_wrong_basin", "int32", "", "runs in a wrong basin in a setting of the instance"),
        Column("n_far", "int32", "", f"{_FAR}, in the draw with most"),
        Column(
            "interval_over", "string", "", "runs, noise draws or replicates; empty: no interval"
        ),
        Column("no_interval", "string", "", "why there are no intervals; empty if there are"),
        Column("misfit", "string", "", "what in the fit table breaks these numbers; empty if none"),
        *_REMARKS,
    ]


def _directions(causes):
    square, error = "rad^2 or m^2", "rad or m"
    name = "rotation_x to translation_z: along an axis of the reference; rotation, translation: in "
    name += "total; weakest: where the instance varies most; error_...: squared error about the "
    name += "truth, wrong basins included"
    vector = "component of the direction in the reference's axes, rotation in units of 1/L"
    growth = "the growth may be shown in per cent: it is positive beyond its interval, and no part "
    growth += "is negative beyond its own; else there are no shares"
    of = "error; its upper end is infinite where so few independent runs bound it from below only"
    parts = {
        "phi": "Shapley value of {}: its part of the growth",
        "removal": "what the value falls by without {}",
        "remaining": "the value without {}",
    }
    return [
        *_PAIR,
        Column("instance", "int32", "", "number of the instance"),
        *_values(causes),
        Column("direction", "string", "", name),
        Column("words", "string", "", "the direction in words"),
        *_columns([f"vector_{k}" for k in range(6)], "float64", "", vector),
        *_estimate("clean", "variance or mean squared error of the clean setting", square),
        *_estimate("value", "variance or mean squared error of the instance", square),
        *_estimate("growth", "the difference of both", square),
        *(
            column
            for part, meaning in parts.items()
            for c in causes
            for column in _estimate(f"{part}_{c.name}", meaning.format(c.title), square)
        ),
        *(
            column
            for c in causes
            for column in _estimate(f"share_{c.name}", f"part of {c.title} in the growth", "-")
        ),
        Column("in_per_cent", "bool", "", growth),
        *_estimate("clean_quantile_95", f"95 % quantile of the clean setting's {of}", error),
        *_estimate("quantile_95", f"95 % quantile of the instance's {of}", error),
        _REASON,
    ]


def _resampled(causes):
    return [
        *_PAIR,
        Column("instance", "int32", "", "number of the instance"),
        Column("resample", "int32", "", "number of the bootstrap sample of the pair's runs"),
        *(
            Column(f"phi_{c.name}", "float64", _F, f"Shapley value of {c.title} in the resample")
            for c in causes
        ),
    ]


TABLES = {
    "scans": _scans,
    "timed_scans": _timed_scans,
    "poses": _poses,
    "registrations": _registrations,
    "overlaps": _overlaps,
    "pairs": _pairs,
    "runs": _runs,
    "estimates": _estimates,
    "descriptors": _descriptors,
    "fit_numbers": _fit_numbers,
    "diagnosis": _diagnosis,
    "instances": _instances,
    "fit": _fit,
    "uncertainty": _uncertainty,
    "shap": _shap,
    "directions": _directions,
    "covariances": _covariances,
    "resampled": _resampled,
}
WITH_CAUSES = (
    "instances",
    "runs",
    "estimates",
    "descriptors",
    "uncertainty",
    "shap",
    "directions",
    "covariances",
    "resampled",
)


# Those of which each row says, where instances are diagnosed, what pair was played on.
OF_GAMES = (
    "runs",
    "estimates",
    "uncertainty",
    "shap",
    "directions",
    "covariances",
    "resampled",
)


def columns(
    table: str, causes: Sequence[Cause | type[Cause]] = (), here: bool = False
) -> list[Column]:
    """The columns of the named table, for an experiment with these causes.

    here: whether its instances are diagnosed, and played on other pairs.
    """
    found = TABLES[table](causes)
    return found + _PLAYED if here and table in OF_GAMES else found


def is_here(plan: Mapping[str, Any] | None) -> bool:
    """Whether a plan is of an experiment whose instances are diagnosed."""
    return "measured" in (plan or {})


def write(
    path: str | Path,
    frame: pd.DataFrame,
    table: str,
    plan: Mapping[str, Any] | None = None,
    causes: Iterable[str] = (),
    **about: Any,
) -> None:
    """Write a frame as the named table, whole or not at all.

    plan: mapping of what decides its numbers, and under `variants` of what the words of the causes
    depend on; causes: names of those that the experiment names, for a table that has columns of
    them; about: what else goes into the file's metadata. Raises
    TableError if a column is missing, unknown or not convertible.
    """
    players = registry.players(causes, (plan or {}).get("variants", {}))
    known = columns(table, players, is_here(plan))
    names = [column.name for column in known]
    if set(names) != set(frame.columns):
        missing, extra = set(names) - set(frame.columns), set(frame.columns) - set(names)
        raise TableError(
            f"{path}: not a {table} table: missing {sorted(missing)}, unknown {sorted(extra)}"
        )
    arrow = pa.Table.from_pandas(frame[names], schema=_schema(known), preserve_index=False)
    about = {"table": table, **({"plan": plan} if plan else {}), **about}
    if table in WITH_CAUSES:
        about["causes"] = [cause.name for cause in registry.named(causes)]
    storage.write(path, arrow, about)


def read(path: str | Path, table: str) -> pd.DataFrame:
    """The frame of a file of the named table.

    Raises TableError if its columns are others, storage.StorageError if the file is damaged.
    """
    found, about = storage.read(path)
    expected = _schema(columns(table, _causes_of(path, about), is_here(about.get("plan"))))
    if not found.schema.equals(expected):
        raise TableError(
            f"{path}: not a {table} table: expected columns {', '.join(expected.names)}, "
            f"found {', '.join(found.schema.names)}.\n"
            "Hint: remove the file; the workflow makes it again."
        )
    return found.to_pandas()


def read_all(paths: Iterable[str | Path], table: str) -> pd.DataFrame:
    """The frames of several files of the named table as one; they must have the same causes."""
    return pd.concat([read(path, table) for path in paths], ignore_index=True)


class ByPair:
    """The rows of files of jobs, tables of runs or estimates, by pair (reference, source).

    A file is read when one of its pairs is asked for, so that pairs in the order of the jobs take
    the memory of a job or two, or of the one pair, however many there are.
    """

    def __init__(self, paths: Iterable[str | Path], table: str) -> None:
        self._paths: dict[tuple[int, int], list] = {}
        for path in paths:
            for pair, *_ in read_about(path)["plan"]["parts"]:
                self._paths.setdefault(tuple(pair), []).append(path)
        self._read = lru_cache(maxsize=1)(partial(read, table=table))

    def get(self, pair: tuple[int, int]) -> pd.DataFrame | None:
        """The rows of a pair, in the order of the files; None if it has none."""
        found = []
        for path in self._paths.get(pair, ()):
            frame = self._read(path)
            rows = frame[(frame["reference"] == pair[0]) & (frame["source"] == pair[1])]
            found += [rows] if len(rows) else []
        return pd.concat(found, ignore_index=True) if found else None


def read_about(path: str | Path) -> dict[str, Any]:
    """What `write` was told of a file besides its rows."""
    return storage.read_about(path)


def read_poses(path: str | Path) -> np.ndarray:
    """Poses T_global_scan (n, 4, 4)."""
    return read(path, "poses")[TRANSFORM].to_numpy().reshape(-1, 4, 4)


def empty(
    table: str, causes: Iterable[str] = (), plan: Mapping[str, Any] | None = None
) -> pd.DataFrame:
    """The named table without rows; causes: their names; plan: as of `write`."""
    return _schema(columns(table, registry.named(causes), is_here(plan))).empty_table().to_pandas()


def write_scans(
    path: str | Path,
    scans: Iterable[tuple[int, np.ndarray, np.ndarray | None, int]],
    plan: Mapping[str, Any],
) -> None:
    """Write scans one after the other, each as a part of its own.

    scans: iterable of (index, points (n, 3) [m], times (n,) or None, rows that were dropped); all
    or none of them have times, as `plan` says under `time`.
    """
    table = "timed_scans" if plan.get("time") else "scans"

    def parts():
        for index, points, times, dropped in scans:
            frame = pd.DataFrame(points, columns=["x", "y", "z"]).assign(scan=index)
            frame = frame if times is None else frame.assign(time=times)
            yield scan_part(index), frame, {"dropped_rows": dropped}

    _write_parts(path, table, parts(), plan)


def read_scan(path: str | Path, index: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Points (n, 3) [m] of a scan of a file, and their times (n,) or None."""
    frame = storage.read_part(path, scan_part(index)).to_pandas()
    times = frame["time"].to_numpy() if "time" in frame else None
    return frame[["x", "y", "z"]].to_numpy(), times


def scan_part(index: int) -> str:
    """Name of a scan, as a part of a file and where a file says what it was made from."""
    return f"scan_{index}"


def write_overlaps(
    path: str | Path,
    overlaps: Iterable[tuple[tuple[int, int], np.ndarray, float]],
    plan: Mapping[str, Any],
) -> None:
    """Write the overlap of pairs, each as a part of its own.

    overlaps: iterable of (indices of reference and source, mask (m,), overlap ratio).
    """

    def parts():
        for (reference, source), overlapping, ratio in overlaps:
            frame = pd.DataFrame({"overlapping": overlapping})
            frame = frame.assign(reference=reference, source=source)
            yield pair_part((reference, source)), frame, {"overlap": ratio}

    _write_parts(path, "overlaps", parts(), plan)


def read_overlap(path: str | Path, indices: tuple[int, int]) -> np.ndarray:
    """Mask (m,) of the overlapping source points of a pair of a file."""
    return storage.read_part(path, pair_part(indices))["overlapping"].to_numpy()


def pair_part(indices: tuple[int, int]) -> str:
    """Name of a pair (reference, source), as a part of a file."""
    return "{}-{}".format(*indices)


def poses_frame(T_global_scan: np.ndarray) -> pd.DataFrame:
    """The table of poses (n, 4, 4), a row a scan."""
    frame = pd.DataFrame(T_global_scan.reshape(-1, 16), columns=TRANSFORM)
    return frame.assign(scan=range(len(T_global_scan)))


def covariances(frame: pd.DataFrame) -> np.ndarray:
    """Covariances (n, 6, 6) of a frame that has the columns of their upper triangles."""
    row, column = np.triu_indices(6)
    upper = frame[COVARIANCE].to_numpy(dtype=float)
    result = np.empty((len(upper), 6, 6))
    result[:, row, column] = result[:, column, row] = upper
    return result


def covariance_columns(covariance: np.ndarray) -> dict[str, float]:
    """The upper triangle of a covariance (6, 6) by column."""
    return dict(zip(COVARIANCE, covariance[np.triu_indices(6)], strict=True))


def _write_parts(path, table, parts, plan):
    """Write frames of the named table, which has no columns of causes, as parts of a file."""
    known = columns(table)
    schema = _schema(known)
    made = (
        (name, pa.Table.from_pandas(frame[schema.names], schema, preserve_index=False), told)
        for name, frame, told in parts
    )
    made = ((name, arrow.replace_schema_metadata(None), told) for name, arrow, told in made)
    storage.write_parts(path, schema, made, {"table": table, "plan": plan})


def _causes_of(path, about):
    names = about.get("causes", [])
    unknown = [name for name in names if name not in registry.CAUSES]
    if unknown:
        raise TableError(
            f"{path}: the file has columns of the causes {', '.join(unknown)}, which do not exist "
            f"here; known are {', '.join(registry.CAUSES)}.\n"
            "Hint: bring back the files of icpshap/causes/ that it was made with, or remove it."
        )
    return registry.named(names)


def _schema(known):
    return pa.schema(
        [
            pa.field(
                column.name,
                pa.type_for_alias(column.type),
                metadata={"unit": column.unit, "description": column.description},
            )
            for column in known
        ]
    )
