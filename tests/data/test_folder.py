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
        (["1.las", "2.las", "poses.txt", "readme.txt"], {}, r"found 2 \.las: known formats are"),
        (["poses.txt"], {}, r"0 scans \(\.csv, .*\), but"),
    ],
)
def test_incomplete_folders(tmp_path, names, options, expected):
    with pytest.raises(DataError, match=expected) as error:
        find_folder_files(own_folder(tmp_path, *names), 2, **options)
    assert "\nHint: " in str(error.value)


def test_without_poses_it_is_said_how_to_go_on(tmp_path):
    with pytest.raises(DataError, match=r"If there are no poses, `poses: register` has ICP make"):
        find_folder_files(own_folder(tmp_path, "1.ply", "2.ply"), 2)


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


def test_a_suffix_of_text_is_a_scan_only_where_nothing_else_is(tmp_path):
    own_folder(tmp_path, "1.ply", "2.ply", "poses.txt", "readme.txt", "times.txt")
    assert [path.name for path in find_folder_files(tmp_path, 2)[0]] == ["1.ply", "2.ply"]
    (tmp_path / "text").mkdir()
    own_folder(tmp_path / "text", "1.txt", "2.txt", "poses.txt")
    paths, poses = find_folder_files(tmp_path / "text", 2)
    assert [path.name for path in paths] == ["1.txt", "2.txt"] and poses.name == "poses.txt"
    (tmp_path / "text/poses.txt").rename(tmp_path / "text/p.tum")
    assert find_folder_files(tmp_path / "text", 2)[1].name == "p.tum"


@pytest.mark.parametrize(
    "suffix", [".bin", ".npy", ".npz", ".xyz", ".pcd.gz", ".ply.gz", ".PLY.GZ"]
)
def test_scans_of_other_kinds(tmp_path, suffix):
    own_folder(tmp_path, f"scan_10{suffix}", f"scan_9{suffix}", "poses.txt")
    paths, _ = find_folder_files(tmp_path, 2)
    assert [path.name for path in paths] == [f"scan_9{suffix}", f"scan_10{suffix}"]


class TestBelow:
    """Scans in subfolders."""

    def below(self, folder, *names):
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).touch()
        return folder

    def names(self, folder, scans, **options):
        paths, poses = find_folder_files(folder, scans, **options)
        return [path.relative_to(folder).as_posix() for path in paths], poses

    def test_all_in_one(self, tmp_path):
        self.below(tmp_path, "velodyne/10.bin", "velodyne/9.bin", "image/9.png", "times.txt")
        names, poses = self.names(own_folder(tmp_path, "poses.txt"), 2)
        assert names == ["velodyne/9.bin", "velodyne/10.bin"] and poses == tmp_path / "poses.txt"

    def test_poses_beside_them(self, tmp_path):
        self.below(tmp_path, "a/b/1.ply", "a/b/2.ply", "a/b/poses.txt")
        names, poses = self.names(tmp_path, 2)
        assert names == ["a/b/1.ply", "a/b/2.ply"] and poses == tmp_path / "a/b/poses.txt"

    def test_one_in_each(self, tmp_path):
        self.below(tmp_path, "scan_10/cloud.pcd", "scan_9/cloud.pcd", "poses.txt")
        assert self.names(tmp_path, 2)[0] == ["scan_9/cloud.pcd", "scan_10/cloud.pcd"]

    def test_those_in_the_folder_itself_come_first(self, tmp_path):
        self.below(tmp_path, "1.ply", "2.ply", "old/1.ply", "poses.txt")
        assert self.names(tmp_path, 2)[0] == ["1.ply", "2.ply"]

    def test_several_in_several(self, tmp_path):
        self.below(tmp_path, "left/1.ply", "left/2.ply", "right/1.ply", "poses.txt")
        expected = r"scans in 2 folders below it: left \(2\), right \(1\); expected all in one, or"
        with pytest.raises(DataError, match=expected) as error:
            find_folder_files(tmp_path, 3)
        assert "set `folder: {path: ...}` to the one that holds the scans" in str(error.value)

    def test_folders_below_are_not_looked_into_where_they_need_not_be(self, tmp_path, monkeypatch):
        self.below(tmp_path, "1.ply", "2.ply", "poses.txt", "private/1.ply")
        listed = type(tmp_path).iterdir

        def iterdir(path):
            if path.name == "private":
                raise PermissionError(13, "Permission denied")
            return listed(path)

        monkeypatch.setattr(type(tmp_path), "iterdir", iterdir)
        assert self.names(tmp_path, 2)[0] == ["1.ply", "2.ply"]

    def test_too_deep(self, tmp_path):
        self.below(tmp_path, "a/b/c/1.ply", "a/b/c/2.ply", "poses.txt")
        with pytest.raises(DataError, match="0 scans"):
            find_folder_files(tmp_path, 2)


class TestOrder:
    """One that is certain, or an error."""

    @pytest.mark.parametrize(
        "names",
        [
            ["a.ply", "b.ply", "c.ply"],
            ["hall_A.ply", "hall_B.ply"],
            ["target.pcd", "source.pcd"],
            ["cloud_reference.ply", "cloud_source.ply"],
            ["fixed.xyz", "moving.xyz"],
            ["1305.175.pcd", "1305.250.pcd", "1306.125.pcd"],
            ["2011-12-03_9.ply", "2012-01-01_1.ply"],
            ["0_hall.ply", "1_entrance.ply"],
        ],
    )
    def test_certain(self, tmp_path, names):
        own_folder(tmp_path, *reversed(names), "poses.txt")
        paths, _ = find_folder_files(tmp_path, len(names))
        assert [path.name for path in paths] == names

    @pytest.mark.parametrize(
        ("names", "expected"),
        [
            (["hall.ply", "stairs.ply"], r"whether hall\.ply or stairs\.ply comes first"),
            (["a.ply", "c.ply"], r"a\.ply or c\.ply"),
            (["left_2.ply", "right_1.ply"], r"left_2\.ply or right_1\.ply"),
            (["a_1.ply", "a_2.ply", "b_1.ply", "b_2.ply"], r"a_2\.ply or b_1\.ply"),
            (["scan.ply", "scan_1.ply"], r"scan\.ply or scan_1\.ply"),
            (["1.5.ply", "1.25.ply"], r"1\.5\.ply or 1\.25\.ply"),
        ],
    )
    def test_uncertain(self, tmp_path, names, expected):
        own_folder(tmp_path, *names, "poses.txt")
        with pytest.raises(DataError, match=f"it is not certain .*{expected}") as error:
            find_folder_files(tmp_path, len(names))
        assert "or list them in order: `files: [" in str(error.value)

    def test_listed(self, tmp_path):
        own_folder(tmp_path, "hall.ply", "stairs.ply", "roof.pcd", "poses.txt")
        files = ["stairs.ply", "hall.ply", "roof.pcd"]
        paths, poses = find_folder_files(tmp_path, 3, files=files)
        assert [path.name for path in paths] == files and poses.name == "poses.txt"

    @pytest.mark.parametrize(
        ("files", "expected"),
        [
            (["hall.ply"], "`files` lists 1 scans, but the configuration says `scans: 2`"),
            (["hall.ply", "cellar.ply"], r"cellar\.ply: no such file"),
            (["hall.ply", "hall.las"], r"found hall\.las: known formats are"),
        ],
    )
    def test_listed_wrong(self, tmp_path, files, expected):
        own_folder(tmp_path, "hall.ply", "stairs.ply", "hall.las", "poses.txt")
        with pytest.raises(DataError, match=expected):
            find_folder_files(tmp_path, 2, files=files)


def test_no_pose_file_is_looked_for_where_icp_makes_the_poses(tmp_path):
    own_folder(tmp_path, "1.txt", "2.txt", "guess.txt")
    paths, poses = find_folder_files(tmp_path, 2, "register", guess="guess.txt")
    assert [path.name for path in paths] == ["1.txt", "2.txt"] and poses is None
