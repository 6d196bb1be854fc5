"""Poses on disk: read and checked strictly, in the data set's, KITTI's and TUM's form.

*Poses* are an (n, 4, 4) array ``T_global_local``, scanner to global frame, translations in metres.
Nothing is corrected silently: whatever does not fit is a `DataError`.
"""

import re
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from icpshap.data.files import readable
from icpshap.data.layout import LEICA_NAME, MINIMUM_SCANS
from icpshap.errors import DataError

ROTATION_TOLERANCE = 1e-4
MAXIMUM_TRANSLATION = 1e7  # m; coordinates from the centre of the Earth are within
MAXIMUM_BYTES = 2**26  # of a pose file: more than 100,000 poses
NUMBER = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?"
QUATERNION = ["qx", "qy", "qz", "qw"]
TUM_COLUMNS = f"timestamp tx ty tz {' '.join(QUATERNION)}"
UPRIGHT = np.deg2rad(30)  # tilt of a scanner that stands on a vehicle or is carried
ROLLED = np.deg2rad(45)  # change of tilt between poses
OVER = np.deg2rad(120)  # tilt of a scanner that has rolled over
NEAR = np.deg2rad(75)  # rotation from the identity, or from lying on its back
LEICA_HEADER = [
    "poseId",
    "timestamp",
    *(f"T{row}{column}" for row in range(4) for column in range(4)),
]


def read_poses(path, scans):
    """Poses T_global_local (scans, 4, 4) of a data-set, KITTI or TUM file.

    Data set: ``pose_scanner_leica.csv``. KITTI: rows of 12 or 16 numbers, row-major. TUM: rows of
    ``timestamp tx ty tz qx qy qz qw``. Line k belongs to scan k. Raises DataError.
    """
    path = Path(path)
    rows, comments = _read_rows(path)
    if not rows:
        raise DataError(f"{path}: no poses.", "the file is empty; get or export it again.")
    if rows[0][1][0] == "poseId":
        lines, poses = _leica_poses(path, rows)
    else:
        lines, poses = _plain_poses(path, rows, comments)
    for line, pose in zip(lines, poses, strict=True):
        _check_pose(f"{path}, line {line}", pose)
    if len(poses) != scans:
        raise DataError(
            f"{path}: {len(poses)} poses, but the configuration says `scans: {scans}`.",
            f"a pose is needed for every scan; if the file is right, change `scans: {scans}` to"
            f" `scans: {len(poses)}` in this sequence's entry under `data`."
            if len(poses) >= MINIMUM_SCANS
            else f"a pose is needed for every scan, and at least {MINIMUM_SCANS} scans; the file"
            " may be cut off.",
        )
    return poses


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


def _leica_poses(path, rows):
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
    return lines, values[:, 2:].reshape(-1, 4, 4)


def _plain_poses(path, rows, comments):
    width = len(rows[0][1])
    if width not in (8, 12, 16):
        raise DataError(
            f"{path}, line {rows[0][0]}: {width} columns; expected 12 or 16 (KITTI), 8 (TUM) or the"
            f" header of {LEICA_NAME}.",
            "write one pose a line in one of these formats.",
        )
    lines, values = _numbers(path, rows, [str(column + 1) for column in range(width)])
    if width == 8:
        return lines, _tum_matrices(path, lines, values, comments)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, : width // 4] = values.reshape(-1, width // 4, 4)
    return lines, poses


def _tum_matrices(path, lines, values, comments):
    for line, step in zip(lines[1:], np.diff(values[:, 0]), strict=True):
        if step <= 0:
            raise DataError(
                f"{path}, line {line}: the timestamp is not later than the one before.",
                "list the poses in the order of the scans.",
            )
    # Four decimals, the format's habit, leave the norm within 1e-4 of 1.
    with np.errstate(over="ignore"):
        norms = np.linalg.norm(values[:, 4:], axis=1)
    for line, norm in zip(lines, norms, strict=True):
        if abs(norm - 1) > ROTATION_TOLERANCE:
            raise DataError(
                f"{path}, line {line}: quaternion of norm {norm:.6g}, expected 1 within"
                f" {ROTATION_TOLERANCE:g}.",
                f"columns are {TUM_COLUMNS}.",
            )
    if not _order_is_said(path, comments):
        _require_scalar_last(path, lines[0], values[:, 4:])
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(values[:, 4:]).as_matrix()
    poses[:, :3, 3] = values[:, 1:4]
    return poses


def _order_is_said(path, comments):
    """Whether a comment names the columns in their order. Raises DataError for another order."""
    for line, words in comments:
        named = [word for word in words if word in QUATERNION]
        if sorted(named) == sorted(QUATERNION):
            if named != QUATERNION:
                raise DataError(
                    f"{path}, line {line}: the columns are {' '.join(named)}, expected"
                    f" {' '.join(QUATERNION)}.",
                    f"reorder them; columns are {TUM_COLUMNS}.",
                )
            return True
    return False


def _require_scalar_last(path, line, quaternions):
    """Raise DataError if only the order qw qx qy qz makes sense of quaternions (n, 4).

    Angles between poses do not tell: they are the same in both orders. What tells is where up is.
    Read with qw first, the scanner must stay upright in all poses, without being so in the order
    qx qy qz qw, in which it

    - either rolls over between the poses,
    - or lies on its back in all of them, turned about x by nearly half a turn. A scanner may hang
      so; but on its way it turns about the vertical (qy) far more than it rolls (qw).
    """
    a, b, c, d = (quaternions * np.where(quaternions[:, :1] < 0, -1, 1)).T
    tilt = np.arccos(np.clip(1 - 2 * (a**2 + b**2), -1, 1))
    tilt_scalar_first = np.arccos(np.clip(1 - 2 * (b**2 + c**2), -1, 1))
    if tilt_scalar_first.max() > UPRIGHT or tilt.max() <= UPRIGHT:
        return
    rolls_over = np.ptp(tilt) > ROLLED and tilt.max() > OVER
    on_its_back = a.min() > np.cos(NEAR / 2) and np.ptp(b) <= 2 * np.ptp(d)
    if rolls_over or on_its_back:
        raise DataError(
            f"{path}, line {line}: read as {' '.join(QUATERNION)}, the scanner"
            f" {'rolls over between the poses' if rolls_over else 'lies on its back'}; read as qw"
            " qx qy qz, it is upright in all of them.",
            f"columns are {TUM_COLUMNS}: move qw to the end. If it is there already, say so in a"
            f" line at the top: # {TUM_COLUMNS}",
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


def _check_pose(where, pose):
    rotation = pose[:3, :3]
    error = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if error > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise DataError(
            f"{where}: the 3x3 part is not a rotation (R^T R differs from the identity by"
            f" {error:.2g}, at most {ROTATION_TOLERANCE:g} is allowed; det R ="
            f" {np.linalg.det(rotation):.3g}).",
            "matrices are row-major, scanner to global frame, without scale; write more decimals.",
        )
    if np.abs(pose[3] - [0, 0, 0, 1]).max() > ROTATION_TOLERANCE:
        raise DataError(
            f"{where}: the last row of the matrix is {pose[3].tolist()}, expected [0, 0, 0, 1].",
            "matrices are row-major; transpose them.",
        )
    if (distance := np.abs(pose[:3, 3]).max()) > MAXIMUM_TRANSLATION:
        raise DataError(
            f"{where}: a translation of {distance:.3g}, expected at most"
            f" {MAXIMUM_TRANSLATION:g} m.",
            "translations are in metres; check the units and the order of the columns.",
        )
