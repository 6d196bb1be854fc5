"""Poses on disk: read and checked strictly, in the data set's, KITTI's and TUM's form.

*Poses* are an (n, 4, 4) array ``T_global_local``, scanner to global frame, translations in metres.
Nothing is corrected silently: whatever does not fit is a `DataError`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from icpshap import rigid
from icpshap.data import drives, quaternions
from icpshap.data.files import readable
from icpshap.data.layout import LEICA_NAME, MINIMUM_SCANS, SCALAR_LAST
from icpshap.errors import DataError

MAXIMUM_TRANSLATION = 1e7  # m; coordinates from the centre of the Earth are within
MAXIMUM_BYTES = 2**26  # of a pose file: more than 100,000 poses
NUMBER = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?"
LEICA_HEADER = [
    "poseId",
    "timestamp",
    *(f"T{row}{column}" for row in range(4) for column in range(4)),
]


class Rows(NamedTuple):
    """The poses of a file: their lines, and their numbers as far as the format is known."""

    lines: list
    values: np.ndarray  # (n, columns)
    stamps: np.ndarray | None  # (n,) times of the poses, where the format has them
    is_tum: bool

    def at(self, places: Sequence[int]) -> Rows:
        """Those at some places (k,)."""
        stamps = None if self.stamps is None else self.stamps[places]
        lines = [self.lines[place] for place in places]
        return Rows(lines, self.values[places], stamps, self.is_tum)


def read_poses(
    path: str | Path,
    scans: int,
    names: Sequence[str] | None = None,
    quaternion: str | None = None,
    scan: Callable[[int], np.ndarray] | None = None,
) -> np.ndarray:
    """Poses T_global_local (scans, 4, 4) of a data-set, KITTI or TUM file.

    Data set: ``pose_scanner_leica.csv``. KITTI: rows of 12 or 16 numbers, row-major. TUM: rows of
    ``timestamp tx ty tz qx qy qz qw``. Line k belongs to scan k; in a file of more poses than
    scans, the one that the scan's file name says (``names``; see `drives`).

    Of two scans, the file may instead hold T_reference_source, source onto reference, alone: a 3x4
    or 4x4 matrix, in one line or in its own. The first scan's frame is then the global one.

    quaternion: their order, one of `layout.ORDERS`; scan: function of an index that reads points
    (n, 3), by which it is found out where it is not said (`quaternions`). Raises DataError.
    """
    path = Path(path)
    rows, comments = _read_rows(path)
    if not rows:
        raise DataError(f"{path}: no poses.", "the file is empty; get or export it again.")
    if len(rows[0][1]) == 4 and scans != 2:
        raise DataError(
            f"{path}: one transform, but the configuration says `scans: {scans}`.",
            "a pose is needed for every scan, of 12 or 16 numbers a line.",
        )
    if _is_transform(rows, scans):
        return _poses_of_two(path, _transform(path, rows))
    found = _rows(path, rows)
    if len(found.lines) > scans and names is not None:
        found = found.at(drives.lines_of_scans(path, len(found.lines), found.stamps, names))
    if len(found.lines) != scans:
        raise _wrong_number(path, len(found.lines), scans)
    poses = _matrices(path, found, comments, quaternion, scan)
    for line, pose in zip(found.lines, poses, strict=True):
        check_pose(f"{path}, line {line}", pose)
    return poses


def read_transforms(path: str | Path) -> np.ndarray:
    """Transforms (n, 4, 4) T_reference_source of pairs, one or more.

    A 3x4 or 4x4 matrix in its own lines, or rows of 16, 12 or 7 numbers: those of a matrix row by
    row, or tx ty tz qx qy qz qw. Raises DataError.
    """
    path = Path(path)
    rows, _ = _read_rows(path)
    if not rows:
        raise DataError(f"{path}: no transforms.", "the file is empty; get or export it again.")
    if len(rows[0][1]) == 4:
        return _transform(path, rows)[None]
    if len(rows[0][1]) == 7:
        lines, values = _numbers(path, rows, quaternions.TRANSFORM_COLUMNS.split())
        return np.array(
            [transform_of(row, f"{path}, line {n}") for n, row in zip(lines, values, strict=True)]
        )
    found = _rows(path, rows)
    if found.values.shape[1] not in (12, 16):
        raise DataError(
            f"{path}: {found.values.shape[1]} columns, expected 16, 12 or 7.",
            "write the rows of a 3x4 or 4x4 matrix T_reference_source one after the other, or "
            f"{quaternions.TRANSFORM_COLUMNS}.",
        )
    transforms = _of_rows(found.values)
    for line, transform in zip(found.lines, transforms, strict=True):
        check_pose(f"{path}, line {line}", transform)
    return transforms


def transform_of(values: Sequence[float] | np.ndarray, where: str) -> np.ndarray:
    """The transform (4, 4) of 16 or 12 numbers, row-major, or of 7, tx ty tz qx qy qz qw.

    Raises DataError if it is none.

    >>> transform_of([1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1, 0], "T")[:3, 3].tolist()
    [0.5, 0.0, 0.0]
    >>> transform_of([0.5, 0, 0, 0, 0, 1, 0], "T").diagonal().tolist()
    [-1.0, -1.0, 1.0, 1.0]
    """
    numbers = np.array([values], dtype=float)
    if numbers.shape[1] == 7:
        _check_norms([where], numbers[:, 3:], quaternions.TRANSFORM_COLUMNS)
        transform = quaternions.matrices(numbers[:, :3], numbers[:, 3:], SCALAR_LAST)[0]
    else:
        transform = _of_rows(numbers)[0]
    check_pose(where, transform)
    return transform


def _is_transform(rows, scans):
    """Whether a file has one matrix: in its own lines, or one line in place of two poses."""
    width = len(rows[0][1])
    return width == 4 or (len(rows) == 1 and scans == 2 and width in (12, 16))


def _poses_of_two(path, T_reference_source):
    """Poses (2, 4, 4) of two scans, of which the first one's frame is the global one."""
    if (T_reference_source == np.eye(4)).all():
        # What a drive begins with.
        raise DataError(
            f"{path}: 1 poses, but the configuration says `scans: 2`; taken for the transform"
            " from one scan to the other, it says that the scanner did not move.",
            "a pose is needed for every scan, and at least 2 scans; the file may be cut off. One"
            " transform T_reference_source does for two.",
        )
    return np.stack([np.eye(4), T_reference_source])


def _transform(path, rows):
    """T_reference_source (4, 4) of a file that has nothing else."""
    width = len(rows[0][1])
    lines, values = _numbers(path, rows, [str(column + 1) for column in range(width)])
    if width == 4 and len(values) not in (3, 4):
        raise DataError(
            f"{path}: {len(values)} rows of 4 numbers, expected 3 or 4, of one matrix.",
            "give one matrix T_reference_source for two scans, or a pose for each scan, of 12 or 16"
            " numbers a line.",
        )
    transform = _of_rows(values.reshape(1, -1))[0]
    check_pose(f"{path}, line {lines[0]}", transform)
    return transform


def _of_rows(values):
    """Matrices (n, 4, 4) of rows (n, 12) or (n, 16)."""
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, : values.shape[1] // 4] = values.reshape(len(values), -1, 4)
    return poses


def _wrong_number(path, poses, scans):
    return DataError(
        f"{path}: {poses} poses, but the configuration says `scans: {scans}`.",
        f"a pose is needed for every scan; if the file is right, change `scans: {scans}` to"
        f" `scans: {poses}` in this sequence's entry under `data`."
        if poses >= MINIMUM_SCANS
        else f"a pose is needed for every scan, and at least {MINIMUM_SCANS} scans; the file"
        " may be cut off.",
    )


def _rows(path, rows):
    """The `Rows` of a file."""
    if rows[0][1][0] == "poseId":
        return _leica_rows(path, rows)
    width = len(rows[0][1])
    if width not in (8, 12, 16):
        raise DataError(
            f"{path}, line {rows[0][0]}: {width} columns; expected 12 or 16 (KITTI), 8 (TUM) or the"
            f" header of {LEICA_NAME}.",
            "write one pose a line in one of these formats; or, for two scans, one 4x4 matrix"
            " T_reference_source.",
        )
    lines, values = _numbers(path, rows, [str(column + 1) for column in range(width)])
    if width != 8:
        return Rows(lines, values, None, False)
    _check_tum(path, lines, values)
    return Rows(lines, values, values[:, 0], True)


def _matrices(path, rows, comments, quaternion, scan):
    """Poses (n, 4, 4) of `Rows`."""
    if not rows.is_tum:
        return _of_rows(rows.values)
    translations, numbers = rows.values[:, 1:4], rows.values[:, 4:]
    order = quaternions.order_of(
        path, rows.lines[0], comments, translations, numbers, quaternion, scan
    )
    return quaternions.matrices(translations, numbers, order)


def _read_rows(path):
    """Line numbers and cells of the rows, and line numbers and words of the comments."""
    with readable(path):
        if (size := path.stat().st_size) > MAXIMUM_BYTES:
            raise DataError(
                f"{path}: {size} bytes, expected at most {MAXIMUM_BYTES} in a pose file.",
                "this may be a scan; name the pose file: `folder: {path: ..., poses: ...}`.",
            )
        content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise DataError(
            f"{path}, line {line}: not a text file in UTF-8.",
            "give a pose file in text form, saved as UTF-8.",
        ) from None
    rows, comments = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("#"):
            comments.append((number, re.findall(r"\w+", line)))
        elif line.strip():
            cells = line.split(",") if "," in line else line.split()
            rows.append((number, [cell.strip() for cell in cells]))
    return rows, comments


def _leica_rows(path, rows):
    (header_line, header), rows = rows[0], rows[1:]
    if header != LEICA_HEADER:
        raise DataError(
            f"{path}, line {header_line}: columns {', '.join(header)}; expected"
            f" {', '.join(LEICA_HEADER)}.",
            "restore the data set's own header.",
        )
    lines, values = _numbers(path, rows, LEICA_HEADER)
    for expected, (line, pose_id) in enumerate(zip(lines, values[:, 0], strict=True)):
        if pose_id != expected:
            raise DataError(
                f"{path}, line {line}: poseId {pose_id:g}, expected {expected}.",
                "ids count from 0 without gaps, one line a scan; restore the missing line.",
            )
    return Rows(lines, values[:, 2:], None, False)


def _check_tum(path, lines, values):
    """Raise DataError unless timestamps increase and quaternions have the norm 1."""
    for line, step in zip(lines[1:], np.diff(values[:, 0]), strict=True):
        if step <= 0:
            raise DataError(
                f"{path}, line {line}: the timestamp is not later than the one before.",
                "list the poses in the order of the scans.",
            )
    where = [f"{path}, line {line}" for line in lines]
    _check_norms(where, values[:, 4:], quaternions.TUM_COLUMNS)


def _check_norms(where, numbers, columns):
    """Raise DataError unless quaternions (n, 4) have the norm 1; columns: all of their rows."""
    # Four decimals, the format's habit, leave the norm within 1e-4 of 1.
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(numbers, axis=1)
    for place, norm in zip(where, norms, strict=True):
        if not abs(norm - 1) <= rigid.TOLERANCE:
            raise DataError(
                f"{place}: quaternion of norm {norm:.6g}, expected 1 within {rigid.TOLERANCE:g}.",
                f"columns are {columns}.",
            )


def _numbers(path, rows, names):
    """Line numbers and values (n, len(names)) of split rows; all must be finite numbers."""
    for line, cells in rows:
        if len(cells) != len(names):
            raise DataError(
                f"{path}, line {line}: {len(cells)} columns, expected {len(names)}.",
                "the file may be cut off or mixed; get or export it again.",
            )
        for name, cell in zip(names, cells, strict=True):
            if not _is_finite_number(cell):
                raise DataError(
                    f"{path}, line {line}, column {name}: {_shown(cell)} is not a finite number.",
                    "numbers are written like -1.5 or 2e-3, with a point; poses must be complete.",
                )
    values = np.array([[float(cell) for cell in cells] for _, cells in rows])
    return [line for line, _ in rows], values.reshape(-1, len(names))


def _is_finite_number(text):
    # Python's float() takes more: 1_000, nan, digits of other scripts.
    return bool(re.fullmatch(NUMBER, text)) and np.isfinite(float(text))


def _shown(text):
    return repr(text if len(text) <= 40 else text[:37] + "...")


def check_pose(where: str, pose: np.ndarray) -> None:
    """Raise DataError if a matrix (4, 4) of finite numbers is no pose; where: what it is called."""
    if found := rigid.fault(pose):
        raise DataError(f"{where}: {found.problem}", found.hint)
    if (distance := np.abs(pose[:3, 3]).max()) > MAXIMUM_TRANSLATION:
        raise DataError(
            f"{where}: a translation of {distance:.3g}, expected at most"
            f" {MAXIMUM_TRANSLATION:g} m.",
            "translations are in metres; check the units and the order of the numbers.",
        )
