"""What is exported: the relative pose of two scans with its covariance, out of a table."""

from __future__ import annotations

import os
import zipfile
from collections import defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from icpshap import se3, storage, tables
from icpshap.causes import CAUSES
from icpshap.errors import UserError
from icpshap.one_pair.explanation import Explanation

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Measurement:
    """A pair of scans in one setting.

    levels: of each cause, by name; T_reference_source (4, 4): the pose that the covariance stands
    at, the true one; covariance (6, 6) [rad, m]: of xi in T_reference_source exp(xi), rotation
    first; NaN of too few runs; n_used of n_runs: the runs that it is of.
    """

    sequence: str
    reference: int
    source: int
    levels: dict[str, float]
    T_reference_source: np.ndarray
    covariance: np.ndarray
    n_used: int
    n_runs: int

    @property
    def is_known(self) -> bool:
        """Whether it has a covariance."""
        return bool(np.isfinite(self.covariance).all())

    @property
    def left_out(self) -> float:
        """The share of its runs that the covariance is not of; 0 of estimators without runs."""
        return 1 - self.n_used / self.n_runs if self.n_runs else 0.0

    @property
    def translation(self) -> np.ndarray:
        """Of its pose (3,) [m]."""
        return self.T_reference_source[:3, 3]

    @property
    def quaternion(self) -> np.ndarray:
        """Of its pose (4,): x, y, z, w."""
        return quaternion(self.T_reference_source)

    @property
    def in_words(self) -> str:
        return f"{self.sequence} {self.reference}-{self.source}"


def quaternion(T: np.ndarray) -> np.ndarray:
    """Rotation of a pose (4, 4) as x, y, z, w with w >= 0: (4,)."""
    return Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)


def read_covariances(path: str | Path) -> pd.DataFrame:
    """The covariances table of a file of the workflow, or of a saved explanation.

    Raises UserError if the file is neither.
    """
    if zipfile.is_zipfile(path):
        return Explanation.load(path).tables["covariances"]
    try:
        about = storage.read_about(path)
    except storage.StorageError:
        about = {}
    table = about.get("table")
    if table != "covariances":
        found = "no such file" if not os.path.exists(path) else "another file"
        found = f"a table of {table}" if table else found
        raise UserError(
            f"{path}: {found}, expected covariances.parquet of the workflow or what "
            "icpshap explain --save wrote.\n"
            "Hint: the workflow's lies in results/<experiment>/<sequence>/, and one of all "
            "sequences in results/<experiment>/."
        )
    if tables.is_here(about.get("plan")):
        raise UserError(
            f"{path}: of an experiment with `instances: here`, whose runs are of other pairs than "
            "those that are explained, expected one whose covariances are those of its pairs.\n"
            "Hint: an experiment with a fixed instance has them."
        )
    return tables.read(path, "covariances")


def measurements(table: pd.DataFrame) -> list[Measurement]:
    """The `Measurement`s of a covariances table, in its order.

    Of several replicates the mean; the second clean sample is none.
    """
    causes = [name for name in CAUSES if name in table.columns]
    found = []
    of_settings = table[~table["again"]].groupby([*tables.PAIR, *causes], sort=False)
    for (sequence, reference, source, *levels), rows in of_settings:
        found.append(
            Measurement(
                sequence,
                int(reference),
                int(source),
                dict(zip(causes, map(float, levels), strict=True)),
                rows[tables.TRANSFORM].to_numpy()[0].reshape(4, 4),
                tables.covariances(rows).mean(axis=0),
                int(rows["n_used"].sum()),
                int(rows["n_runs"].sum()),
            )
        )
    return found


def of_sequence(measured: Sequence[Measurement], key: str | None) -> list[Measurement]:
    """Those of one sequence; all of them for None. Raises UserError for a key that is not there."""
    known = list(dict.fromkeys(measurement.sequence for measurement in measured))
    if key is not None and key not in known:
        raise UserError(f"--sequence {key}: expected one of {', '.join(known)}.\nHint: check it.")
    return [one for one in measured if key in (None, one.sequence)]


def instance(measured: Sequence[Measurement], asked: Mapping[str, float]) -> dict[str, float]:
    """Level by cause that is exported: what is asked for, else the only one that is not off.

    asked: level by cause. Raises UserError for a level that was not run, and where several were and
    none is asked for.
    """
    names = list(measured[0].levels)
    levels = {}
    for name in {**dict.fromkeys(names), **asked}:
        off = CAUSES[name].off
        known = sorted({one.levels.get(name, off) for one in measured} - {off})
        told = ", ".join(f"{level:g}" for level in (off, *known))
        option = f"--{name.replace('_', '-')}"
        if name in asked:
            if asked[name] not in (off, *known):
                raise UserError(
                    f"{option} {asked[name]:g}: not in the table, expected one of {told}.\n"
                    f"Hint: {off:g} is off; run the experiment with another level for others."
                )
            levels[name] = asked[name]
        elif len(known) > 1:
            raise UserError(
                f"{name}: the table has the levels {told}, expected one.\n"
                f"Hint: {option} {known[-1]:g}"
            )
        else:
            levels[name] = known[0] if known else off
    return {name: levels[name] for name in names}


def at(measured: Sequence[Measurement], levels: Mapping[str, float]) -> list[Measurement]:
    """The measurements of the setting with these levels by cause."""
    return [one for one in measured if one.levels == levels]


def coalitions(measured: Sequence[Measurement], levels: Mapping[str, float]) -> list[Measurement]:
    """The measurements of settings in which each cause is at its level or off."""
    return [
        one
        for one in measured
        if all(one.levels[name] in (levels[name], CAUSES[name].off) for name in levels)
    ]


def placed(measured: Sequence[Measurement]) -> tuple[dict[int, np.ndarray], list[int]]:
    """Where scans are by the measured poses: T_first_scan (4, 4) by index, and those of firsts.

    The first scan of what hangs together stands at the identity. With more measurements than are
    needed the shortest chain counts.
    """
    neighbours = defaultdict(list)
    for one in measured:
        neighbours[one.reference].append((one.source, one.T_reference_source))
        neighbours[one.source].append((one.reference, se3.inverse(one.T_reference_source)))
    poses, firsts = {}, []
    for first in sorted(neighbours):
        if first in poses:
            continue
        firsts.append(first)
        poses[first] = np.eye(4)
        waiting = deque([first])
        while waiting:
            known = waiting.popleft()
            for index, T_known_index in neighbours[known]:
                if index not in poses:
                    poses[index] = poses[known] @ T_known_index
                    waiting.append(index)
    return dict(sorted(poses.items())), firsts
