"""The command icpshap export: which files it reads and writes, and what it refuses."""

import numpy as np
import pytest
from known_measurements import ON, table

from icpshap import cli, tables


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "covariances.parquet"
    tables.write(path, table(), "covariances", causes=ON)
    return path


def run(*arguments):
    return cli.main(["export", *map(str, arguments)])


def test_it_writes_to_a_file_or_prints(file, tmp_path, capsys):
    assert run(file, "--to", "g2o", "--output", tmp_path / "drive.g2o") == 0
    assert capsys.readouterr().out == ""
    assert run(file, "--to", "g2o") == 0
    assert capsys.readouterr().out == (tmp_path / "drive.g2o").read_text()


def test_of_two_files_the_second_has_a_name_of_its_own(file, tmp_path, capsys):
    assert run(file, "--to", "tum", "--output", tmp_path / "drive.tum") == 0
    assert np.loadtxt(tmp_path / "drive.tum").shape == (4, 8)
    assert np.loadtxt(tmp_path / "drive_covariances.tum").shape == (4, 22)
    assert run(file, "--to", "tum") == 1
    assert "makes 2 files, expected --output" in capsys.readouterr().err


def test_clean_is_all_causes_off_and_a_level_may_be_given_with_it(file, capsys):
    def sigma(*arguments):
        assert run(file, "--to", "json", *arguments) == 0
        text = capsys.readouterr().out
        return text.split('"sensor_noise": ')[1].split(",")[0]

    assert sigma() == "0.02"
    assert sigma("--clean") == "0.0"
    assert sigma("--clean", "--sensor-noise", "0.02") == "0.02"


def test_pairs_without_a_covariance_are_told(file, capsys):
    frame = table()
    frame.loc[frame["reference"] == 2, "covariance_00"] = np.nan
    tables.write(file, frame, "covariances", causes=ON)
    assert run(file, "--to", "ros") == 0
    said = capsys.readouterr()
    assert "icpshap: 1 pair(s) without a covariance are left out, the first is drive 2-3." in (
        said.err
    )
    assert "scan_2 in" in said.out and "scan_3 in" not in said.out


def test_a_file_that_is_none_is_refused(file, tmp_path, capsys):
    for path, said in (
        (tmp_path / "no.parquet", "no such file"),
        (tmp_path / "a.txt", "another file"),
        (tmp_path / "shap.parquet", "a table of shap"),
    ):
        if said == "another file":
            path.write_text("no table")
        if said == "a table of shap":
            tables.write(path, tables.empty("shap", ON), "shap", causes=ON)
        assert run(path, "--to", "g2o") == 1
        told = capsys.readouterr().err
        assert f"{path}: {said}, expected covariances.parquet" in told and "Hint: " in told


def test_a_place_that_cannot_be_written_is_named(file, tmp_path, capsys):
    assert run(file, "--to", "g2o", "--output", tmp_path / "no" / "drive.g2o") == 1
    assert "drive.g2o: cannot be written" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["", ".", ".."])
def test_a_place_that_is_no_file_is_named(file, place, capsys):
    assert run(file, "--to", "g2o", "--output", place) == 1
    assert f"--output {place}: cannot be written" in capsys.readouterr().err


def test_the_table_itself_is_not_overwritten(file, capsys):
    before = file.read_bytes()
    assert run(file, "--to", "g2o", "--output", file) == 1
    assert "would overwrite another file of this command" in capsys.readouterr().err
    assert file.read_bytes() == before


def test_a_table_without_rows_is_refused(tmp_path, capsys):
    path = tmp_path / "covariances.parquet"
    tables.write(path, tables.empty("covariances", ON), "covariances", causes=ON)
    assert run(path, "--to", "json") == 1
    assert "The table has no rows" in capsys.readouterr().err


def test_covariances_that_are_of_no_runs_leave_out_none(file, capsys):
    tables.write(file, table().assign(n_runs=0, n_used=0), "covariances", causes=ON)
    assert run(file, "--to", "g2o") == 0
    assert capsys.readouterr().err == ""
