"""A scan format is one file: put there, it is found; one that does not fit is refused by name."""

import shutil
import subprocess
import sys

import pytest
from conftest import REPOSITORY
from known_files import written

from icpshap.data.scans import SCAN_SUFFIXES

SPACE_SEPARATED = """\
import numpy as np

SUFFIXES = (".asc", ".pts")


def read(path):
    return np.loadtxt(path, ndmin=2)
"""


@pytest.fixture
def formats(tmp_path):
    """The folder of formats in a copy of the library, to which a test may add."""
    shutil.copytree(
        REPOSITORY / "icpshap",
        tmp_path / "icpshap",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    return tmp_path / "icpshap/data/formats"


def run(formats, program, *arguments):
    """The process of a program that uses the copied library."""
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        cwd=formats.parents[2],
        capture_output=True,
        text=True,
    )


def refused(formats):
    """What is said when the library's formats are imported."""
    process = run(formats, "import icpshap.data.scans")
    assert process.returncode == 1
    assert "ImportError: " in process.stderr and "\nHint: " in process.stderr
    return process.stderr.partition("ImportError: ")[2]


def test_suffixes_are_those_documented():
    text = (".csv", ".xyz", ".txt")
    arrays = (".bin", ".npy", ".npz")
    clouds = (".ply", ".ply.gz", ".pcd", ".pcd.gz")
    assert sorted(SCAN_SUFFIXES) == sorted((*text, *arrays, *clouds))
    documented = (REPOSITORY / "docs" / "data.md").read_text(encoding="utf-8")
    assert [suffix for suffix in SCAN_SUFFIXES if f"`{suffix}`" not in documented] == []


def test_a_new_file_is_a_new_format(formats, tmp_path):
    written(formats / "space_separated.py", SPACE_SEPARATED)
    folder = tmp_path / "garden"
    folder.mkdir()
    written(folder / "scan_9.asc", "1 2 3\n4 5 6.5\n")
    written(folder / "scan_10.ASC", "7 8 9\nnan 0 0\n")
    written(folder / "poses.txt", "")
    process = run(
        formats,
        "import sys\n"
        "from icpshap.data.folder import find_folder_files\n"
        "from icpshap.data.scans import SCAN_SUFFIXES, read_scan\n"
        "print(SCAN_SUFFIXES)\n"
        "paths, poses = find_folder_files(sys.argv[1], 2)\n"
        "for path in paths:\n"
        "    points, dropped = read_scan(path, drop_non_finite=True)\n"
        "    print(path.name, points.tolist(), dropped)\n",
        folder,
    )
    assert process.stdout.splitlines() == [
        str((*SCAN_SUFFIXES, ".asc", ".pts")),
        "scan_9.asc [[1.0, 2.0, 3.0], [4.0, 5.0, 6.5]] 0",
        "scan_10.ASC [[7.0, 8.0, 9.0]] 1",
    ], process.stderr


def test_a_suffix_of_two_formats_is_refused(formats):
    written(formats / "another.py", SPACE_SEPARATED.replace(".asc", ".ply"))
    said = refused(formats)
    assert str(formats / "another.py") in said and str(formats / "ply.py") in said
    assert "both have '.ply' in SUFFIXES" in said


@pytest.mark.parametrize("suffixes", ['(".ASC",)', '("asc",)', '(".asc")', '(".asc.xz",)'])
def test_a_suffix_that_no_scan_can_have_is_refused(formats, suffixes):
    written(formats / "another.py", SPACE_SEPARATED.replace('(".asc", ".pts")', suffixes))
    assert refused(formats).startswith(f"{formats / 'another.py'}: SUFFIXES = ")


@pytest.mark.parametrize("name", ["SUFFIXES", "read"])
def test_a_module_that_is_no_format_is_refused(formats, name):
    written(formats / "another.py", SPACE_SEPARATED.replace(name, "other"))
    assert refused(formats).startswith(f"{formats / 'another.py'}: no {name}; ")


def test_shared_parts_are_no_formats(formats):
    written(formats / "_another.py", "raise ValueError")
    process = run(formats, "import icpshap.data.scans")
    assert process.returncode == 0, process.stderr


def test_formats_are_found_without_importing_open3d(formats):
    process = run(formats, "import sys, icpshap.data.scans; assert 'open3d' not in sys.modules")
    assert process.returncode == 0, process.stderr
