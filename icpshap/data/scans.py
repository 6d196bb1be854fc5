"""Scans and poses on disk: found, read and checked strictly.

A *scan* is an (n, 3) float64 array [m] in the scanner frame; *poses* are an (n, 4, 4) array
``T_global_local``, scanner to global frame. Nothing is corrected silently: whatever does not fit
is a `DataError`.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from icpshap import se3
from icpshap.data.open3d_loader import load_open3d
from icpshap.errors import UserError

MINIMUM_POINTS = 1000
ROTATION_TOLERANCE = 1e-4
OVERLAP_DISTANCE = 0.2  # m; the paper's distance between overlapping points
SANITY_POINTS = 5000

LEICA_NAME = "pose_scanner_leica.csv"
LEICA_PLACES = ("leica", "csv_global", "csv_local")
LEICA_HEADER = [
    "poseId",
    "timestamp",
    *(f"T{row}{column}" for row in range(4) for column in range(4)),
]
SCAN_SUFFIXES = (".csv", ".ply", ".pcd")
MINIMUM_SCANS = 2  # the reference and the source of one pair
GET_AGAIN = "the file may be cut off or edited; get or export it again."


class DataError(UserError):
    """Data that cannot be used: the message names the place, what was expected and what to do."""

    def __init__(self, problem, hint):
        super().__init__(f"{problem}\nHint: {hint}")


# Finding files


def find_folder_files(folder, scans, pose_file=None):
    """The scan files of a folder in order, and its pose file: ([Path] * scans, Path).

    The folder is laid out either like the data set (``csv_local/Hokuyo_<i>.csv`` and
    ``pose_scanner_leica.csv`` in ``leica/``, ``csv_global/`` or ``csv_local/``) or as a user's own:
    .ply, .pcd or .csv scans, ordered by the numbers in their names, beside the pose file: named
    ``poses.*``, or else the only ``*.txt`` or ``*.tum``. ``pose_file``, relative to the folder,
    overrides the search. Raises DataError.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DataError(
            f"{folder}: no such folder.",
            "set `folder: {path: ...}` to the one that holds the scans.",
        )
    is_data_set = (folder / "csv_local").is_dir()
    if pose_file is not None:
        pose_path = folder / pose_file
        if not pose_path.is_file():
            raise DataError(
                f"{pose_path}: no such pose file.",
                f"`folder: {{path: ..., poses: ...}}`: `poses` is relative to {folder}.",
            )
    else:
        pose_path = _data_set_pose_file(folder) if is_data_set else _own_pose_file(folder)
    if is_data_set:
        return _data_set_scans(folder / "csv_local", scans), pose_path
    return _own_scans(folder, scans, pose_path), pose_path


def _data_set_scans(folder, scans):
    paths = [folder / name for name in _scan_names(scans)]
    missing = [path.name for path in paths if not path.is_file()]
    found = len(list(folder.glob("Hokuyo_*.csv")))
    if missing or found != scans:
        example = f"; missing: {', '.join(missing[:3])}" if missing else ""
        raise DataError(
            f"{folder}: {found} files Hokuyo_<i>.csv, but the configuration says `scans: {scans}`"
            f" (numbered from 0 without gaps){example}.",
            _scans_hint(found, all((folder / name).is_file() for name in _scan_names(found))),
        )
    return paths


def _scan_names(scans):
    return [f"Hokuyo_{index}.csv" for index in range(scans)]


def _scans_hint(found, without_gaps):
    if not without_gaps:
        return "complete the folder, or number the files, and their poses, from 0 without gaps."
    if found < MINIMUM_SCANS:
        return f"complete the folder; at least {MINIMUM_SCANS} scans are needed."
    return f"complete the folder, or set `scans: {found}` if these are all."


def _data_set_pose_file(folder):
    for place in LEICA_PLACES:
        if (folder / place / LEICA_NAME).is_file():
            return folder / place / LEICA_NAME
    raise DataError(
        f"{folder}: no {LEICA_NAME} in {', '.join(place + '/' for place in LEICA_PLACES)}.",
        "copy it to one of these, or name another file: `folder: {path: ..., poses: ...}`.",
    )


def _own_pose_file(folder):
    files = sorted(path for path in folder.iterdir() if path.is_file() and path.name[0] != ".")
    found = [path for path in files if _is_named_poses(path)]
    found = found or [path for path in files if path.suffix in (".txt", ".tum")]
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise DataError(
            f"{folder}: expected one pose file (poses.* or {LEICA_NAME}, else the only *.txt or"
            f" *.tum), found {names}.",
            "name the right one: `folder: {path: ..., poses: ...}`. For the data set's own files,"
            " the folder is the one that holds csv_local/.",
        )
    return found[0]


def _is_named_poses(path):
    return path.stem == "poses" or path.name == LEICA_NAME


def _own_scans(folder, scans, pose_path):
    paths = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SCAN_SUFFIXES
        and path.name[0] != "."
        and path != pose_path
        and not _is_named_poses(path)
    ]
    kinds = sorted({path.suffix.lower() for path in paths})
    if len(kinds) > 1:
        raise DataError(
            f"{folder}: scans of different kinds ({', '.join(kinds)}).",
            "keep one kind in the folder, so that their order is clear.",
        )
    if len(paths) != scans:
        raise DataError(
            f"{folder}: {len(paths)} scans ({', '.join(kinds or SCAN_SUFFIXES)}),"
            f" but the configuration says `scans: {scans}`.",
            _scans_hint(len(paths), without_gaps=True)
            if paths
            else "set `folder: {path: ...}` to the one that holds the scans.",
        )
    return sorted(paths, key=lambda path: _natural_order(path.name))


def _natural_order(name):
    """Sort key by which scan_2 comes before scan_10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


# Scans


def read_scan(path, drop_non_finite=False):
    """Points (n, 3) [m] of a .csv, .ply or .pcd file, and how many non-finite rows were dropped.

    A .csv file has a header line; the columns named x, y and z are used (the data set's
    ``Hokuyo_<i>.csv`` or a user's own). Non-finite rows are an error unless ``drop_non_finite``.
    Raises DataError.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SCAN_SUFFIXES:
        raise DataError(
            f"{path}: no scan format of this name.", f"use one of {', '.join(SCAN_SUFFIXES)}."
        )
    points = _read_csv(path) if suffix == ".csv" else _read_point_cloud(path, suffix)
    if not len(points):
        raise DataError(f"{path}: no points.", "get or export the file again.")
    finite = np.isfinite(points).all(axis=1)
    dropped = int(np.count_nonzero(~finite))
    if dropped and not drop_non_finite:
        raise DataError(
            f"{path}: {dropped} of {len(points)} rows are not finite (NaN or infinite x, y or z),"
            f" the first is row {np.argmin(finite) + 1} of the points.",
            "remove them, or set `drop_non_finite: true` to leave them out and count them.",
        )
    return points[finite], dropped


def _read_csv(path):
    with path.open("rb") as file:
        header = file.readline().decode("utf-8-sig", errors="replace")
    names = [name.strip() for name in header.split(",")]
    if any(names.count(axis) != 1 for axis in "xyz"):
        raise DataError(
            f"{path}, line 1: expected a header with the columns x, y and z, each once, separated"
            f" by commas; found {header.strip()[:80]!r}.",
            "the file may be empty or of another format; name the columns in its first line.",
        )
    try:
        table = pa.csv.read_csv(
            path,
            # Only the single-threaded parser knows the row number of an error.
            read_options=pa.csv.ReadOptions(use_threads=False, skip_rows=1, column_names=names),
            convert_options=pa.csv.ConvertOptions(
                include_columns=list("xyz"),
                column_types=dict.fromkeys("xyz", pa.float64()),
                null_values=[],
            ),
        )
    except pa.ArrowInvalid as error:
        raise _csv_error(path, names, str(error)) from None
    return np.column_stack([table[axis].to_numpy() for axis in "xyz"])


def _csv_error(path, names, message):
    """DataError for what pyarrow's parser says."""
    if match := re.search(r"Row #(\d+): Expected (\d+) columns, got (\d+)", message):
        line, expected, found = match.groups()
        return DataError(f"{path}, line {line}: {found} columns, expected {expected}.", GET_AGAIN)
    if match := re.search(r"column #(\d+): Row #(\d+): .* invalid value '(.*)'", message, re.S):
        column, line, value = match.groups()
        return DataError(
            f"{path}, line {line}, column {names[int(column)]}: {value!r} is not a number.",
            GET_AGAIN,
        )
    return DataError(f"{path}: {message}", GET_AGAIN)


def _read_point_cloud(path, suffix):
    read_header = _ply_header if suffix == ".ply" else _pcd_header
    with path.open("rb") as file:
        try:
            header = read_header(file)
        except (KeyError, ValueError, IndexError):
            raise DataError(
                f"{path}: no readable {suffix} header (of a cloud with plain x, y, z columns).",
                "the file may be empty, cut off or of another format; export it again.",
            ) from None
        header_bytes = file.tell()
        body = file.read()
        file.seek(0)
        header_lines = file.read(header_bytes).count(b"\n")
    if missing := [axis for axis in "xyz" if axis not in header.columns]:
        raise DataError(
            f"{path}: no column {', '.join(missing)} in the header; its columns are"
            f" {', '.join(header.columns) or 'none'}.",
            "a scan needs the columns x, y and z, in lower case; rename them or export with them.",
        )
    if header.encoding == "ascii":
        return _ascii_points(path, header, body, header_lines)
    _require_complete(path, header, body)
    open3d = load_open3d()
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        cloud = open3d.io.read_point_cloud(str(path), format=suffix[1:])
    return np.array(cloud.points)


class _Header(NamedTuple):
    points: int
    encoding: str
    columns: list  # their names, in the order of a row
    row_bytes: int


def _ascii_points(path, header, body, header_lines):
    """Points (n, 3) of the text after a header.

    Not read with Open3D: at a token that is no number, its readers silently leave the points
    zero or whatever is in memory.
    """
    lines = body.decode("ascii", errors="replace").split("\n")
    rows = [(number, line.split()) for number, line in enumerate(lines, start=header_lines + 1)]
    rows = [(number, cells) for number, cells in rows if cells][: header.points]
    if len(rows) < header.points or (rows and len(rows[-1][1]) < len(header.columns)):
        raise _cut_off(path, header)
    values = [_row_values(path, number, cells, header.columns) for number, cells in rows]
    order = [header.columns.index(axis) for axis in "xyz"]
    return np.array(values, dtype=float).reshape(-1, len(header.columns))[:, order]


def _row_values(path, number, cells, columns):
    if len(cells) != len(columns):
        raise DataError(
            f"{path}, line {number}: {len(cells)} columns, expected {len(columns)}.", GET_AGAIN
        )
    values = []
    for name, cell in zip(columns, cells, strict=True):
        try:
            # Python's 1_0 is no number in a file.
            values.append(float(cell.replace("_", "?")))
        except ValueError:
            raise DataError(
                f"{path}, line {number}, column {name}: {cell!r} is not a number.", GET_AGAIN
            ) from None
    return values


def _require_complete(path, header, body):
    """Raise DataError if a binary file holds less than its header says.

    Open3D fills the missing points with whatever is in memory.
    """
    if header.encoding == "binary_compressed":
        expected_bytes = 8 + int.from_bytes(body[:4], "little")
    else:
        expected_bytes = header.points * header.row_bytes
    if len(body) < expected_bytes:
        raise _cut_off(path, header)


def _cut_off(path, header):
    return DataError(
        f"{path}: the header says {header.points} points, but the file ends before the last one.",
        "the file is cut off; copy or export it again.",
    )


PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}


def _header_lines(file, last):
    for line in file:
        words = line.decode("ascii").split()
        if words:
            yield words
        if words[:1] == [last]:
            return
    raise ValueError(f"no {last}")


def _ply_header(file):
    """`_Header`; the vertices come first in the body."""
    points, encoding, columns, row_bytes, element = None, None, [], 0, None
    for words in _header_lines(file, "end_header"):
        if words[0] == "format":
            encoding = words[1]
        elif words[0] == "element":
            element = words[1]
            if element == "vertex":
                points = int(words[2])
            elif points is None:
                raise ValueError("vertices are not the first element")
        elif words[0] == "property" and element == "vertex":
            row_bytes += PLY_BYTES[words[1]]
            columns.append(words[2])
    if points is None or encoding is None:
        raise ValueError("no vertices")
    return _Header(points, encoding, columns, row_bytes)


def _pcd_header(file):
    entries = {words[0]: words[1:] for words in _header_lines(file, "DATA")}
    names = entries["FIELDS"]
    sizes = [int(size) for size in entries["SIZE"]]
    counts = [int(count) for count in entries.get("COUNT", ["1"] * len(sizes))]
    columns = [name for name, count in zip(names, counts, strict=True) for _ in range(count)]
    row_bytes = sum(size * count for size, count in zip(sizes, counts, strict=True))
    return _Header(int(entries["POINTS"][0]), entries["DATA"][0], columns, row_bytes)


def check_scan(points, minimum_range, where):
    """Raise DataError unless at least 1,000 points (n, 3) lie beyond ``minimum_range`` [m]."""
    far = int(np.count_nonzero(np.linalg.norm(points, axis=1) > minimum_range))
    if far < MINIMUM_POINTS:
        raise DataError(
            f"{where}: {far} of {len(points)} points are farther than {minimum_range} m from the"
            f" scanner, at least {MINIMUM_POINTS} are needed.",
            "check that the scan is in metres and in the scanner's own frame; the chain's"
            " minimum range leaves out what is nearer.",
        )


# Poses


def read_poses(path, scans):
    """Poses T_global_local (scans, 4, 4) of a data-set, KITTI or TUM file.

    Data set: ``pose_scanner_leica.csv``. KITTI: rows of 12 or 16 numbers, row-major. TUM: rows of
    ``timestamp tx ty tz qx qy qz qw``. Line k belongs to scan k. Raises DataError.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise DataError(f"{path}: not a text file.", "give a pose file in text form.") from None
    rows = [
        (number, [cell.strip() for cell in (line.split(",") if "," in line else line.split())])
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise DataError(f"{path}: no poses.", "the file is empty; get or export it again.")
    if rows[0][1][0] == "poseId":
        lines, poses = _leica_poses(path, rows)
    else:
        lines, poses = _plain_poses(path, rows)
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


def _plain_poses(path, rows):
    width = len(rows[0][1])
    if width not in (8, 12, 16):
        raise DataError(
            f"{path}, line {rows[0][0]}: {width} columns; expected 12 or 16 (KITTI), 8 (TUM) or the"
            f" header of {LEICA_NAME}.",
            "write one pose a line in one of these formats.",
        )
    lines, values = _numbers(path, rows, [str(column + 1) for column in range(width)])
    if width == 8:
        return lines, _tum_matrices(path, lines, values)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, : width // 4] = values.reshape(-1, width // 4, 4)
    return lines, poses


def _tum_matrices(path, lines, values):
    for line, step in zip(lines[1:], np.diff(values[:, 0]), strict=True):
        if step <= 0:
            raise DataError(
                f"{path}, line {line}: the timestamp is not later than the one before.",
                "list the poses in the order of the scans.",
            )
    # Four decimals, the format's habit, leave the norm within 1e-4 of 1.
    norms = np.linalg.norm(values[:, 4:], axis=1)
    for line, norm in zip(lines, norms, strict=True):
        if abs(norm - 1) > ROTATION_TOLERANCE:
            raise DataError(
                f"{path}, line {line}: quaternion of norm {norm:.6g}, expected 1 within"
                f" {ROTATION_TOLERANCE:g}.",
                "columns are timestamp tx ty tz qx qy qz qw.",
            )
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(values[:, 4:]).as_matrix()
    poses[:, :3, 3] = values[:, 1:4]
    return poses


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
                    f"{path}, line {line}, column {name}: {cell!r} is not a finite number.",
                    "poses must be complete; get or export the file again.",
                )
    values = np.array([[float(cell) for cell in cells] for _, cells in rows])
    return [line for line, _ in rows], values.reshape(-1, len(names))


def _is_finite_number(text):
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


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


# Ground truth


def ground_truth_distance(reference, source, T_reference_source, minimum_range):
    """Median distance [m] from source points to their nearest reference point, and a warning.

    ``reference`` and ``source``: (n, 3), each in its own scanner frame; points within
    ``minimum_range`` [m] (the robot itself, which moves along) are left out. The warning, "" if all
    is well, says that the median is above 0.2 m (less than half of the source overlaps), or that
    the clouds fit better with no motion or with the inverse motion (poses of the wrong convention).
    """
    reference = reference[np.linalg.norm(reference, axis=1) > minimum_range]
    source = source[np.linalg.norm(source, axis=1) > minimum_range]
    tree = cKDTree(reference)
    sample = source[:: -(-len(source) // SANITY_POINTS)]

    def median_distance(T):
        return float(np.median(tree.query(se3.transform(T, sample))[0]))

    distance = median_distance(T_reference_source)
    others = {
        "with no motion at all": np.eye(4),
        "with the inverse motion": se3.inverse(T_reference_source),
    }
    for description, T in others.items():
        if (other := median_distance(T)) < 0.9 * distance:
            return distance, (
                f"the ground truth looks wrong: {description} the clouds are nearer to each other"
                f" (median {other:.3f} m) than at it ({distance:.3f} m). Hint: poses map scanner to"
                " global frame, and line k belongs to scan k."
            )
    if distance > OVERLAP_DISTANCE:
        return distance, (
            f"the ground truth looks wrong, or the scans hardly overlap: at it, half of the source"
            f" points are farther than {distance:.3f} m from the reference (usual: below"
            f" {OVERLAP_DISTANCE} m). Hint: check units (metres) and the order of scans and poses."
        )
    return distance, ""
