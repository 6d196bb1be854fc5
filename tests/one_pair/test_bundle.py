"""What `icpshap bundle` writes is all that is needed to see again what a user saw, and no more."""

import shlex
import zipfile

import numpy as np
import pytest

from icpshap.cli import main


@pytest.fixture
def scans(tmp_path):
    generator = np.random.default_rng(0)
    for name in ("private_a", "private_b"):
        np.save(tmp_path / f"{name}.npy", generator.uniform(-4, 4, (1200, 3)))
    return [str(tmp_path / f"{name}.npy") for name in ("private_a", "private_b")]


def test_its_command_runs_on_what_is_in_it(scans, tmp_path, capsys, monkeypatch):
    path = tmp_path / "bundle.zip"
    pose = ["--transform", "0.1", "0", "0", "0", "0", "0", "1"]
    options = ["--option", "normal_neighbours=30", "--sensor-noise", "0.05"]
    options += ["--perturbation", "overlap_distance=0.3"]
    assert main(["bundle", *scans, *pose, *options, "--output", str(path)]) == 0
    assert main(["fit", *scans, *pose, *options]) == 0
    told = capsys.readouterr().out.split("\n", 1)[1]
    assert "fits" in told
    with zipfile.ZipFile(path) as file:
        file.extractall(tmp_path / "unpacked")
    monkeypatch.chdir(tmp_path / "unpacked")
    _, command, *words = shlex.split((tmp_path / "unpacked/command.txt").read_text())
    assert command == "explain"
    assert main(["fit", *words]) == 0
    assert capsys.readouterr().out == told


def test_no_name_of_a_file_is_in_it(scans, tmp_path):
    path = tmp_path / "bundle.zip"
    assert main(["bundle", *scans, "--output", str(path)]) == 0
    with zipfile.ZipFile(path) as file:
        parts = {name: file.read(name) for name in file.namelist()}
    assert sorted(parts) == ["command.txt", "reference.npy", "source.npy", "versions.json"]
    assert not any(b"private" in content for content in parts.values())


def test_a_place_that_cannot_be_written_is_said_first(scans, capsys):
    assert main(["bundle", *scans, "--output", "/nowhere/bundle.zip"]) == 1
    assert "/nowhere/bundle.zip" in capsys.readouterr().err
