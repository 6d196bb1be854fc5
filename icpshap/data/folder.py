"""The scans and the pose file of a folder, found by their names without reading them."""

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

from icpshap.data.files import readable
from icpshap.data.layout import LEICA_NAME, LEICA_PLACES, MINIMUM_SCANS
from icpshap.data.scans import SCAN_SUFFIXES
from icpshap.errors import DataError

NOTES = ("", ".txt", ".tum", ".md")  # endings of files that may lie beside scans


def find_folder_files(folder, scans, pose_file=None):
    """The scan files of a folder in order, and its pose file: ([Path] * scans, Path).

    The folder is laid out either like the data set (``csv_local/Hokuyo_<i>.csv`` and
    ``pose_scanner_leica.csv`` in ``leica/``, ``csv_global/`` or ``csv_local/``) or as a user's own:
    scans of one kind out of SCAN_SUFFIXES, ordered by the numbers in their names, beside the pose
    file: named ``poses.*``, or else the only ``*.txt`` or ``*.tum``. ``pose_file``, relative to the
    folder, overrides the search. Raises DataError.
    """
    folder = Path(folder)
    files = _files(folder)
    is_data_set = (folder / "csv_local").is_dir()
    if pose_file is not None:
        pose_path = folder / pose_file
        if not pose_path.is_file():
            raise DataError(
                f"{pose_path}: no such pose file.",
                f"`folder: {{path: ..., poses: ...}}`: `poses` is relative to {folder}.",
            )
    else:
        pose_path = _data_set_pose_file(folder) if is_data_set else _own_pose_file(folder, files)
    if is_data_set:
        return _data_set_scans(folder / "csv_local", scans), pose_path
    return _own_scans(folder, files, scans, pose_path), pose_path


def _files(folder):
    """What lies in a folder and is not hidden, ordered by name."""
    try:
        if not folder.is_dir():
            raise DataError(
                f"{folder}: {'no folder' if folder.exists() else 'no such folder'}.",
                "set `folder: {path: ...}` to the one that holds the scans.",
            )
        return sorted(path for path in folder.iterdir() if path.name[0] != ".")
    except OSError as error:
        raise DataError(
            f"{folder}: cannot be read ({error.strerror or error}).",
            "check the permissions of the folder, and the disk.",
        ) from None


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


def _own_pose_file(folder, files):
    files = [path for path in files if not path.is_dir()]
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
    with readable(found[0]):
        return found[0]


def _is_named_poses(path):
    return path.stem == "poses" or path.name == LEICA_NAME


def _own_scans(folder, files, scans, pose_path):
    others = [path for path in files if path != pose_path and not _is_named_poses(path)]
    paths = [path for path in others if path.suffix.lower() in SCAN_SUFFIXES]
    kinds = sorted({path.suffix.lower() for path in paths})
    if len(kinds) > 1:
        raise DataError(
            f"{folder}: scans of different kinds ({', '.join(kinds)}).",
            "keep one kind in the folder, so that their order is clear.",
        )
    if not paths and (unknown := _counted_suffixes(others)):
        raise DataError(
            f"{folder}: 0 scans, found {unknown}: known formats are {', '.join(SCAN_SUFFIXES)}.",
            "convert the scans to one of these, or set `folder: {path: ...}` to the folder that"
            " holds them.",
        )
    if len(paths) != scans:
        raise DataError(
            f"{folder}: {len(paths)} scans ({', '.join(kinds or SCAN_SUFFIXES)}),"
            f" but the configuration says `scans: {scans}`.",
            _scans_hint(len(paths), without_gaps=True)
            if paths
            else "set `folder: {path: ...}` to the one that holds the scans.",
        )
    for path in paths:
        with readable(path):
            pass
    return _in_order(folder, paths)


def _counted_suffixes(paths):
    """In words, the three commonest suffixes of files that are no text: "2 .bin, 1 .las"."""
    suffixes = Counter(
        path.suffix.lower()
        for path in paths
        if not path.is_dir() and path.suffix.lower() not in NOTES
    )
    return ", ".join(f"{count} {suffix}" for suffix, count in suffixes.most_common(3))


def _in_order(folder, paths):
    """The scans by the numbers in their names, among which no two may be equal."""
    paths = sorted(paths, key=lambda path: _natural_order(path.name))
    for one, other in pairwise(paths):
        if _natural_order(one.name) == _natural_order(other.name):
            raise DataError(
                f"{folder}: {one.name} and {other.name} have the same numbers, expected names that"
                " say which comes first.",
                "rename one of them, or take it away if it is a copy.",
            )
    return paths


def _natural_order(name):
    """Sort key by which scan_2 comes before scan_10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]
