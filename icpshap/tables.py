"""The parquet files: columns, types and units, and how they are read and written.

A file carries, beside its columns, only what decides its numbers (seed, estimator, data, code), so
that the same inputs give the same bytes.
"""

import json
import os
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from icpshap.causes import NAMES, SOURCES
from icpshap.errors import UserError

INITIAL_XI = [f"initial_xi_{k}" for k in range(6)]
XI = [f"xi_{k}" for k in range(6)]
TRANSFORM = [f"T_{row}{column}" for row in range(4) for column in range(4)]


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
_PAIR = [
    Column("sequence", "string", "", "key of the sequence"),
    Column("reference", "int32", "", "index of the reference scan"),
    Column("source", "int32", "", "index of the source scan, which ICP moves"),
]
_VALUES = [Column(s.name, "float64", s.unit, f"{s.title} {s.symbol}") for s in SOURCES]
# The unit of f and of all that is shared out of it: nats, m or rad, as the divergence says.
_F = "f"
_NULL = [
    Column("null_mean", "float64", _F, "mean of f between independent samples of one distribution"),
    Column("null_95", "float64", _F, "95 % quantile of f between such samples"),
]
_REMARKS = [
    Column("warning", "string", "", "what makes these numbers doubtful; empty if nothing"),
    Column("reason", "string", "", "why the pair was not registered; empty if it was"),
]


def _estimate(name, meaning):
    """A number that is shared out of the runs, with its 95 % interval."""
    return [
        Column(name, "float64", _F, meaning),
        Column(f"{name}_low", "float64", _F, "lower end of its 95 % interval"),
        Column(f"{name}_high", "float64", _F, "upper end of its 95 % interval"),
    ]


def _variants(name):
    """The same number, had the runs or the floor been treated otherwise."""
    return [
        Column(f"{name}_all", "float64", _F, "with every run kept that did not fail"),
        Column(f"{name}_right_basin", "float64", _F, "without the runs in a wrong basin"),
        Column(f"{name}_floor_tenfold", "float64", _F, "with ten times the covariance floor"),
        Column(f"{name}_floor_tenth", "float64", _F, "with a tenth of the covariance floor"),
    ]


def _shapley(source):
    name = f"phi_{source.name}"
    ratio = "variance over whole noise draws divided by the one over runs; NaN with one noise draw"
    return [
        *_estimate(name, f"Shapley value of {source.title}: its part of f"),
        Column(f"{name}_significant", "bool", "", "its interval does not contain 0"),
        Column(f"{name}_draw_variance_ratio", "float64", "", ratio),
        *_variants(name),
    ]


TABLES = {
    "scan": _columns(["x", "y", "z"], "float64", "m", "coordinate in the scanner's frame"),
    "poses": [
        Column("scan", "int32", "", "index of the scan"),
        *_columns(TRANSFORM, "float64", "", "entry of T_global_scan, translation in m"),
    ],
    "overlap": [
        Column("overlapping", "bool", "", "a reference point is near this source point"),
    ],
    "pairs": [
        *_PAIR,
        Column("reference_points", "int64", "", "points of the raw reference scan"),
        Column("source_points", "int64", "", "points of the raw source scan"),
        Column("overlap", "float64", "", "overlap ratio O at the true pose"),
        Column(
            "median_distance",
            "float64",
            "m",
            "median distance of source points to the reference at the true pose",
        ),
        Column("registered", "bool", "", "whether the pair is registered"),
        Column("reason", "string", "", "why the pair is not registered"),
        Column("warning", "string", "", "why the true pose looks wrong"),
    ],
    "runs": [
        *_VALUES,
        Column("replicate", "int32", "", "independent repetition"),
        Column("draws", "int32", "", "0; 1: the second clean sample, with draws of its own"),
        Column("run", "int32", "", "index of the run"),
        Column("noise_draw", "int32", "", "index of the noise draw"),
        *_columns(INITIAL_XI, "float64", _XI_UNITS, "drawn error of the initial pose"),
        *_columns(XI, "float64", _XI_UNITS, "pose error log(inv(T_gt) T_icp)"),
        *_columns(TRANSFORM, "float64", "", "entry of T_reference_source, translation in m"),
        Column("iterations", "int32", "", "ICP iterations"),
        Column("status", "string", "", "ok, max_iterations, too_few_links or degenerate"),
        Column("rmse", "float64", "m", "root mean square residual of the kept links"),
        Column("inlier_ratio", "float64", "", "share of the links that were kept"),
        Column("wrong_basin", "bool", "", "far from the setting's median pose"),
    ],
    "uncertainty": [
        *_PAIR,
        Column("replicate", "int32", "", "independent repetition"),
        *_VALUES,
        Column("draws", "int32", "", "0; 1: the second clean sample, with draws of its own"),
        *_estimate("f", "uncertainty: the divergence from the clean setting"),
        Column("f_draw_variance_ratio", "float64", "", "as that of phi in the shap table"),
        Column("kl", "float64", "nats", "KL(clean, perturbed), without bias correction"),
        *_NULL,
        Column("n_runs", "int32", "", "registrations that were run"),
        Column("n_failed", "int32", "", "runs whose status is neither ok nor max_iterations"),
        Column("n_wrong_basin", "int32", "", "runs in a wrong basin"),
        Column("n_used", "int32", "", "runs that f is computed from"),
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
    ],
    "shap": [
        *_PAIR,
        Column("instance", "int32", "", "number of the instance"),
        *_VALUES,
        Column("base_value", "float64", _F, "f of the clean setting"),
        *_estimate("f", "uncertainty of the instance: the divergence from the clean setting"),
        *_variants("f"),
        *(column for source in SOURCES for column in _shapley(source)),
        *(
            column
            for a, b in combinations(NAMES, 2)
            for column in _estimate(f"interaction_{a}_{b}", "Shapley interaction index")
        ),
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
        Column("n_failed", "int32", "", "runs that failed in a setting of the instance"),
        Column("n_wrong_basin", "int32", "", "runs in a wrong basin in a setting of the instance"),
        Column("interval_over", "string", "", "runs, noise draws or replicates"),
        *_REMARKS,
    ],
    "resampled": [
        *_PAIR,
        Column("instance", "int32", "", "number of the instance"),
        Column("resample", "int32", "", "number of the bootstrap sample of the pair's runs"),
        *(
            Column(f"phi_{s.name}", "float64", _F, f"Shapley value of {s.title} in the resample")
            for s in SOURCES
        ),
    ],
}


def write(path, frame, table, decided_by=None):
    """Write a frame as the named table, atomically; `decided_by` goes into the file's metadata.

    Raises TableError if a column is missing, unknown or not convertible.
    """
    columns = TABLES[table]
    names = [column.name for column in columns]
    if set(names) != set(frame.columns):
        missing, extra = set(names) - set(frame.columns), set(frame.columns) - set(names)
        raise TableError(
            f"{path}: not a {table} table: missing {sorted(missing)}, unknown {sorted(extra)}"
        )
    arrow = pa.Table.from_pandas(frame[names], schema=_schema(table), preserve_index=False)
    metadata = {"icpshap": json.dumps({"table": table, **(decided_by or {})}, sort_keys=True)}
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    pq.write_table(arrow.replace_schema_metadata(metadata), temporary)
    os.replace(temporary, path)


def read(path, table):
    """The frame of a file of the named table. Raises TableError if its columns are others."""
    file = pq.ParquetFile(path)
    expected = _schema(table)
    if not file.schema_arrow.equals(expected):
        found = ", ".join(file.schema_arrow.names)
        raise TableError(
            f"{path}: not a {table} table: expected columns {', '.join(expected.names)}, "
            f"found {found}.\nHint: remove the file; the workflow makes it again."
        )
    return file.read().to_pandas()


def read_metadata(path):
    """What decided the numbers of a file, as `write` was told."""
    return json.loads(pq.read_schema(path).metadata[b"icpshap"])


def read_points(path):
    """Points (n, 3) [m] of a scan."""
    return read(path, "scan")[["x", "y", "z"]].to_numpy()


def read_poses(path):
    """Poses T_global_scan (n, 4, 4)."""
    return read(path, "poses")[TRANSFORM].to_numpy().reshape(-1, 4, 4)


def empty(table):
    """The named table without rows."""
    return _schema(table).empty_table().to_pandas()


def points_frame(points):
    return pd.DataFrame(points, columns=["x", "y", "z"])


def poses_frame(T_global_scan):
    frame = pd.DataFrame(T_global_scan.reshape(-1, 16), columns=TRANSFORM)
    return frame.assign(scan=range(len(T_global_scan)))


def _schema(table):
    return pa.schema(
        [
            pa.field(
                column.name,
                pa.type_for_alias(column.type),
                metadata={"unit": column.unit, "description": column.description},
            )
            for column in TABLES[table]
        ]
    )
