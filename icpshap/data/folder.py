"""The scans and the pose file of a folder, found by their names without reading them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from icpshap.data.files import readable
from icpshap.data.formats import suffix_of
from icpshap.data.layout import LEICA_NAME, LEICA_PLACES, MINIMUM_SCANS, REGISTER
from icpshap.data.order import in_order
from icpshap.data.scans import SCAN_SUFFIXES
from icpshap.errors import DataError

TEXT = ".txt"  # the suffix of scans that notes and poses have too
DEPTH = 2  # levels of folders below the one that is named
NOTES = ("", ".txt", ".tum", ".md")  # endings of files that may lie beside scans


def find_files(folder: Mapping[str, Any], scans: int) -> tuple[list[Path], Path | None]:
    """`find_folder_files` of a folder as the configuration has it, by its keys."""
    named = {key: folder.get(key) for key in ("files", "guess")}
    if not isinstance(named["guess"], str):
        named["guess"] = None
    return find_folder_files(folder["path"], scans, folder.get("poses"), **named)


def find_folder_files(
    folder: str | Path,
    scans: int,
    pose_file: str | None = None,
    files: Sequence[str] | None = None,
    guess: str | None = None,
) -> tuple[list[Path], Path | None]:
    """The scan files of a folder in order, and its pose file: ([Path] * scans, Path).

    The folder is laid out either like the data set (``csv_local/Hokuyo_<i>.csv`` and
    ``pose_scanner_leica.csv`` in ``leica/``, ``csv_global/`` or ``csv_local/``) or as a user's own:
    scans of one kind out of SCAN_SUFFIXES, ordered by the numbers in their names, in it or below
    it, beside the pose file: named ``poses.*``, or else the only ``*.txt`` or ``*.tum``.

    ``pose_file``, ``files`` (the scans in their order) and ``guess`` (a file that is none of them),
    all relative to the folder, override the search; there is no pose file, but None, where
    ``pose_file`` is REGISTER. Raises DataError.
    """
    folder = Path(folder)
    entries = _files(folder)
    is_data_set = (folder / "csv_local").is_dir()
    not_scans = {folder / name for name in (pose_file, guess) if name}
    if guess is not None and not (folder / guess).is_file():
        raise DataError(
            f"{folder / guess}: no such file of transforms.",
            f"`folder: {{path: ..., guess: ...}}`: `guess` is relative to {folder}, or 12 numbers.",
        )
    if is_data_set and files is None:
        pose_path = _pose_path(folder, pose_file, lambda: _data_set_pose_file(folder))
        return _data_set_scans(folder / "csv_local", scans), pose_path
    others = [path for path in entries if path not in not_scans and not _is_named_poses(path)]
    paths = _candidates(folder, others, not_scans) if files is None else [folder / n for n in files]
    beside = [path for path in entries if path not in not_scans]
    pose_path = _pose_path(folder, pose_file, lambda: _own_pose_file(folder, beside, paths))
    if files is None:
        return _own_scans(folder, others, paths, scans), pose_path
    return _listed(folder, paths, scans), pose_path


def _pose_path(folder, pose_file, search):
    """The pose file of that name, or else what search() finds; None where ICP makes the poses."""
    if pose_file is None:
        return search()
    if pose_file == REGISTER:
        return None
    if not (folder / pose_file).is_file():
        raise DataError(
            f"{folder / pose_file}: no such pose file.",
            f"`folder: {{path: ..., poses: ...}}`: `poses` is relative to {folder}; `poses:"
            f" {REGISTER}` does without one.",
        )
    return folder / pose_file


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


def _own_pose_file(folder, entries, scans):
    """The pose file among what lies in a folder, or beside its scans where these lie below it."""
    below, scans = {path.parent for path in scans}, set(scans)
    for place in [entries, *([_files(*below)] if len(below) == 1 and folder not in below else [])]:
        files = [path for path in place if not path.is_dir() and path not in scans]
        found = [path for path in files if _is_named_poses(path)]
        found = found or [path for path in files if path.suffix in (".txt", ".tum")]
        if len(found) == 1:
            with readable(found[0]):
                return found[0]
        if found:
            break
    names = ", ".join(path.name for path in found) or "none"
    raise DataError(
        f"{folder}: expected one pose file (poses.* or {LEICA_NAME}, else the only *.txt or"
        f" *.tum), found {names}.",
        "name the right one: `folder: {path: ..., poses: ...}`. If there are no poses, `poses:"
        f" {REGISTER}` has ICP make them. For the data set's own files, the folder is the one that"
        " holds csv_local/.",
    )


def _is_named_poses(path):
    return path.stem == "poses" or path.name == LEICA_NAME


def _listed(folder, paths, scans):
    """The scans that the configuration lists."""
    if len(paths) != scans:
        raise DataError(
            f"{folder}: `files` lists {len(paths)} scans, but the configuration says"
            f" `scans: {scans}`.",
            "list every scan once, in order.",
        )
    for path in paths:
        if suffix_of(path) not in SCAN_SUFFIXES:
            raise _unknown_format(folder, path.name)
        with readable(path):
            pass
    return paths


def _unknown_format(folder, found):
    return DataError(
        f"{folder}: 0 scans, found {found}: known formats are {', '.join(SCAN_SUFFIXES)}.",
        "convert the scans to one of these, or set `folder: {path: ...}` to the folder that"
        " holds them.",
    )


def _own_scans(folder, others, paths, scans):
    """The scans at these paths in their order; others: all that may be meant by them."""
    kinds = sorted({suffix_of(path) for path in paths})
    if len(kinds) > 1:
        raise DataError(
            f"{folder}: scans of different kinds ({', '.join(kinds)}).",
            "keep one kind in the folder, so that their order is clear.",
        )
    known = [path for path in paths if suffix_of(path) != TEXT]
    if not known and len(paths) != scans and (unknown := _counted_suffixes(others)):
        raise _unknown_format(folder, unknown)
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
    return in_order(folder, paths)


def _candidates(folder, others, not_scans):
    """The files that are scans by their suffix: in the folder itself, or else below it.

    Text may be anything, so that it is a scan only where nothing else is.
    """
    formats = set(SCAN_SUFFIXES) - {TEXT}
    if here := _of_formats(others, formats):
        return here
    below = _below(folder, not_scans)
    return (
        _all_or_one(folder, below, formats)
        or _of_formats(others, {TEXT})
        or _all_or_one(folder, below, {TEXT})
    )


def _of_formats(paths, suffixes):
    return [path for path in paths if suffix_of(path) in suffixes]


def _all_or_one(folder, below, suffixes):
    """The scans of some formats in the folders below one: all in one of them, or one in each."""
    found = {place: _of_formats(files, suffixes) for place, files in below.items()}
    found = {place: files for place, files in found.items() if files}
    if len(found) > 1 and any(len(files) > 1 for files in found.values()):
        counts = [f"{place.relative_to(folder)} ({len(files)})" for place, files in found.items()]
        raise DataError(
            f"{folder}: scans in {len(found)} folders below it: {', '.join(counts[:4])}"
            f"{', ...' if len(counts) > 4 else ''}; expected all in one, or one in each.",
            "set `folder: {path: ...}` to the one that holds the scans.",
        )
    return [path for files in found.values() for path in files]


def _below(folder, not_scans):
    """What lies in the folders below one, DEPTH levels down, by folder."""
    found: dict[Path, list[Path]] = {}
    level = [folder]
    for _ in range(DEPTH):
        level = [path for place in level for path in _files(place) if path.is_dir()]
        found |= {place: _files(place) for place in level}
    return {
        place: [path for path in files if path not in not_scans and not _is_named_poses(path)]
        for place, files in found.items()
    }


def _counted_suffixes(paths):
    """In words, the three commonest suffixes of files that are no text: "2 .las, 1 .e57"."""
    suffixes = Counter(
        path.suffix.lower()
        for path in paths
        if not path.is_dir() and path.suffix.lower() not in NOTES
    )
    return ", ".join(f"{count} {suffix}" for suffix, count in suffixes.most_common(3))
