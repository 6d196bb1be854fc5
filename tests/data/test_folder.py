"""Which files of a folder are its scans and its poses."""

import pytest
from known_files import POINTS, POSES
from misbehaving_server import write_folder

from icpshap.data.folder import find_folder_files
from icpshap.data.layout import LEICA_NAME, LEICA_PLACES
from icpshap.errors import DataError


@pytest.mark.parametrize("place", LEICA_PLACES)
def test_data_set_folder(tmp_path, place):
    write_folder(tmp_path, [POINTS[:3]] * 12, POSES, place)
    paths, poses = find_folder_files(tmp_path, 12)
    assert [path.name for path in paths] == [f"Hokuyo_{index}.csv" for index in range(12)]
    assert poses == tmp_path / place / "pose_scanner_leica.csv"


def own_folder(folder, *names):
    for name in names:
        (folder / name).touch()
    return folder


def test_own_folder_in_natural_order(tmp_path):
    own_folder(tmp_path, "scan_10.ply", "scan_9.ply", "scan_1.PLY", "poses.txt", "readme.txt")
    own_folder(tmp_path, "._scan_9.ply", ".DS_Store")
    paths, poses = find_folder_files(tmp_path, 3)
    assert [path.name for path in paths] == ["scan_1.PLY", "scan_9.ply", "scan_10.ply"]
    assert poses.name == "poses.txt"


@pytest.mark.parametrize(
    "name", ["poses.csv", "pose_scanner_leica.csv", "trajectory.tum", "gt.txt"]
)
def test_pose_file_beside_csv_scans(tmp_path, name):
    paths, poses = find_folder_files(own_folder(tmp_path, "1.csv", "2.csv", name), 2)
    assert [path.name for path in paths] == ["1.csv", "2.csv"] and poses.name == name


def test_pose_file_can_be_named(tmp_path):
    own_folder(tmp_path, "1.csv", "2.csv", "truth.csv", "poses.txt")
    paths, poses = find_folder_files(tmp_path, 2, "truth.csv")
    assert [path.name for path in paths] == ["1.csv", "2.csv"] and poses.name == "truth.csv"


@pytest.mark.parametrize(
    ("names", "options", "expected"),
    [
        (["1.ply"], {}, "expected one pose file .*found none"),
        (["1.ply", "a.txt", "b.txt"], {}, r"expected one pose file .*found a\.txt, b\.txt"),
        (["1.ply", "poses.txt"], {"pose_file": "p.txt"}, r"p\.txt: no such pose file"),
        (["1.ply", "2.pcd", "poses.txt"], {}, r"scans of different kinds \(\.pcd, \.ply\)"),
        (["1.ply", "poses.txt"], {}, r"1 scans \(\.ply\), but the configuration says `scans: 2`"),
        (["poses.txt"], {}, r"0 scans \(\.csv, \.ply, \.pcd\), but"),
    ],
)
def test_incomplete_folders(tmp_path, names, options, expected):
    with pytest.raises(DataError, match=expected) as error:
        find_folder_files(own_folder(tmp_path, *names), 2, **options)
    assert "\nHint: " in str(error.value)


def test_incomplete_data_set_folder(tmp_path):
    write_folder(tmp_path, [POINTS[:3]] * 5, POSES)
    (tmp_path / "csv_local/Hokuyo_3.csv").unlink()
    with pytest.raises(DataError, match=r"4 files .*`scans: 5`.*missing: Hokuyo_3.csv"):
        find_folder_files(tmp_path, 5)
    (tmp_path / "leica/pose_scanner_leica.csv").unlink()
    with pytest.raises(DataError, match=r"no pose_scanner_leica.csv in leica/, csv_global/, csv_l"):
        find_folder_files(tmp_path, 5)


@pytest.mark.parametrize(
    ("numbers", "scans", "hint"),
    [
        ([0, 1, 2, 4], 4, "number the files, and their poses, from 0 without gaps."),
        ([0, 1, 2, 4], 5, "number the files, and their poses, from 0 without gaps."),
        ([0, 1, 2], 4, "complete the folder, or set `scans: 3` if these are all."),
        ([0], 2, "complete the folder; at least 2 scans are needed."),
    ],
)
def test_hint_for_scans_that_do_not_count_up(tmp_path, numbers, scans, hint):
    (tmp_path / "leica").mkdir()
    (tmp_path / "csv_local").mkdir()
    own_folder(tmp_path / "leica", LEICA_NAME)
    own_folder(tmp_path / "csv_local", *(f"Hokuyo_{number}.csv" for number in numbers))
    with pytest.raises(DataError) as error:
        find_folder_files(tmp_path, scans)
    assert f": {len(numbers)} files" in str(error.value) and str(error.value).endswith(hint)


def test_hint_for_own_scans(tmp_path):
    own_folder(tmp_path, "1.ply", "poses.txt")
    with pytest.raises(DataError, match=r"Hint: complete the folder; at least 2 scans are needed"):
        find_folder_files(tmp_path, 2)
    own_folder(tmp_path, "2.ply")
    with pytest.raises(DataError, match=r"Hint: .*set `scans: 2` if these are all"):
        find_folder_files(tmp_path, 3)


def test_missing_folder(tmp_path):
    with pytest.raises(DataError, match="nowhere: no such folder"):
        find_folder_files(tmp_path / "nowhere", 5)
