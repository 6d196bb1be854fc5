"""The command: what it prints, writes, and how it ends."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from conftest import REPOSITORY

import icpshap
from icpshap import cli

# Processes elsewhere import the code of this checkout.
THERE = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
FAST = ("--estimator", "paper", "--option", "runs=60", "--option", "subsampling_probability=0.2")
FAST += ("--option", "maximum_iterations=20")


@pytest.fixture(scope="session")
def files(scans, tmp_path_factory):
    """Two scans and the transform as files."""
    folder = tmp_path_factory.mktemp("scans")
    for name, points in zip(("reference", "source"), scans[:2], strict=True):
        np.save(folder / f"{name}.npy", points)
    np.savetxt(folder / "T.txt", scans[2])
    return folder


@pytest.fixture
def scans_given(files):
    return [str(files / "reference.npy"), str(files / "source.npy")]


def test_a_screen_is_printed_and_files_are_written(files, scans_given, tmp_path, capsys):
    T = str(files / "T.txt")
    wanted = [f"--{name}={tmp_path / name}" for name in ("html", "covariance", "save")]
    assert cli.main(["explain", *scans_given, "--transform", T, *FAST, *wanted]) == 0
    said = capsys.readouterr().out
    assert said.startswith("Pose error (root mean square): clean ")
    assert len(said.splitlines()) <= 40
    covariance = np.loadtxt(tmp_path / "covariance")
    assert covariance.shape == (6, 6)
    assert "rotation first" in (tmp_path / "covariance").read_text()
    loaded = icpshap.Explanation.load(tmp_path / "save")
    assert covariance == pytest.approx(np.asarray(loaded.covariance))
    assert (tmp_path / "html").read_text().startswith("<!doctype html>")


def test_numbers_in_the_place_of_a_file_and_json(files, scans_given, scans, capsys):
    T = scans[2]
    numbers = [f"{entry:.17g}" for entry in T[:3].ravel()]
    assert any(number.startswith("-") for number in numbers)
    arguments = ["explain", *scans_given, "--transform", *numbers, *FAST, "--json"]
    assert cli.main([*arguments, "--partial-overlap", "0", "--sensor-noise", "0.05"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["levels"] == {"sensor_noise": 0.05, "initial_pose": 1.5}
    assert np.array(found["T_reference_source"]) == pytest.approx(T)


@pytest.mark.parametrize("numbers", [["-1e-3", "0", "0", "0", "0", "0", "1"]])
def test_negative_numbers_with_exponents_are_no_options(numbers):
    assert cli._joined(["--transform", *numbers, "--json"]) == [
        f"--transform={' '.join(numbers)}",
        "--json",
    ]


def test_fit_says_each_check_without_icp(files, scans_given, capsys):
    T = str(files / "T.txt")
    assert cli.main(["fit", *scans_given, "--transform", T, "--estimator", "paper"]) == 0
    said = capsys.readouterr().out
    assert "true pose" in said
    assert len(said.splitlines()) == 9


def test_fit_takes_another_registration_which_has_no_normals_of_ours(files, scans_given, capsys):
    arguments = ["fit", *scans_given, "--transform", str(files / "T.txt")]
    assert cli.main([*arguments, "--register", "small_gicp"]) == 0
    said = capsys.readouterr().out
    assert "true pose" in said and "rings" not in said


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["explain", "nowhere.ply", "source.npy"], "nowhere.ply"),
        (["explain", "reference.npy", "source.npy", "--option", "runs"], "expected KEY=VALUE"),
        (["explain", "reference.npy", "source.npy", "--option", "runz=3"], "did you mean 'runs'"),
        (["explain", "reference.npy", "source.npy", "--register", "small_gic"], "small_gicp"),
        (["explain", "reference.npy", "source.npy", "--transform", "1", "2"], "shape (2,)"),
        (["explain", "reference.npy", "source.npy", "--transform", "no.txt"], "no.txt"),
        (["explain", "reference.npy", "source.npy", "--html", "no/a.html"], "cannot be written"),
        (["explain", "reference.npy", "source.npy", "--what-if", "runs"], "expected KEY=VALUE"),
        (["explain", "reference.npy", "source.npy", "--html", "."], "cannot be written"),
        (["explain", "reference.npy", "source.npy", "--save", ""], "cannot be written"),
        (["explain", "reference.npy", "source.npy", "--save", "source.npy"], "overwrite another"),
        (["explain", "reference.npy", "source.npy", "--seed", "-1"], "seed: -1 is less"),
        (
            ["explain", "reference.npy", "source.npy", "--what-if", "a:runs=60", "a:runs=70"],
            "twice",
        ),
        (
            ["fit", "reference.npy", "source.npy", "--option", "runs=60", "--option", "runs=70"],
            "twice",
        ),
        (
            [
                *("fit", "reference.npy", "source.npy", "--transform", "T.txt"),
                *("--initial-transform", "0", "0", "0", "0", "0", "0", "1"),
            ],
            "T_initial: given with T",
        ),
        (
            [
                *("explain", "reference.npy", "source.npy", "--sensor-noise", "0"),
                *("--initial-pose", "1", "--partial-overlap", "0"),
            ],
            "causes: all are off",
        ),
        (["fit", "reference.npy", "T.txt"], "4 points, expected at least 1000"),
    ],
)
def test_what_cannot_be_used_ends_with_1_and_a_hint(files, arguments, message, capsys, monkeypatch):
    monkeypatch.chdir(files)
    assert cli.main(arguments) == 1
    said = capsys.readouterr().err
    assert said.startswith("icpshap: ")
    assert message in said
    assert "Hint: " in said and "docs/" not in said  # which an installed package has not
    assert "Traceback" not in said


@pytest.mark.parametrize("arguments", [[], ["explain"], ["explain", "a", "b", "--thread", "x"]])
def test_a_wrong_command_line_ends_with_2(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(arguments)
    assert end.value.code == 2


def test_version_and_help_have_what_one_needs(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert capsys.readouterr().out.strip() == f"icpshap {icpshap.__version__}"
    with pytest.raises(SystemExit):
        cli.main(["explain", "--help"])
    said = capsys.readouterr().out
    assert "examples:" in said
    for cause in ("--sensor-noise", "--motion-distortion"):
        assert cause in said


@pytest.mark.parametrize("seconds", [0.3, 4])  # while it imports, while threads run
def test_ctrl_c_ends_at_once_with_130_and_no_traceback(files, scans_given, seconds):
    command = [sys.executable, "-m", "icpshap", "explain", *scans_given]
    command += ["--transform", str(files / "T.txt"), "--option", "runs=20000"]
    started = subprocess.Popen(command, stderr=subprocess.PIPE, env=THERE, text=True)
    time.sleep(seconds)
    assert started.poll() is None
    started.send_signal(signal.SIGINT)
    # On a machine that does something else besides; without it the runs take minutes.
    _, said = started.communicate(timeout=20)
    assert started.returncode == 130
    assert "Traceback" not in said
    assert "icpshap: stopped" in said


def run(arguments, cwd, **options):
    command = [sys.executable, "-m", "icpshap", *arguments]
    return subprocess.run(command, cwd=cwd, capture_output=True, check=False, **options)


def test_what_a_user_s_module_has_written_is_on_disk_at_the_end(files):
    """Also where it closes no file: Python does, unless what it holds is taken to stay."""
    (files / "noting.py").write_text(
        "calls = open('calls.log', 'w')\n"
        "def register(reference, source, T_initial):\n"
        "    calls.write('called\\n')\n"
        "    return T_initial\n"
    )
    arguments = ["explain", "reference.npy", "source.npy", "--transform", "T.txt", "--json"]
    done = run([*arguments, "--register", "noting:register"], files, env=THERE)
    assert done.returncode == 0, done.stderr
    calls = (files / "calls.log").read_text().split("\n")
    assert set(calls[:-1]) == {"called"}
    assert calls[-1] == ""
    assert len(calls[:-1]) == 901  # of nine settings, and once before


def test_letters_that_the_terminal_does_not_know_are_replaced(files):
    done = run(["fit", "--help"], files, env={**THERE, "PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    assert b"--sensor-noise ?" in done.stdout


def test_json_is_utf_8_in_any_locale_and_a_full_disk_is_said(files):
    arguments = ["explain", "reference.npy", "source.npy", "--transform", "T.txt", *FAST, "--json"]
    done = run(arguments, files, env={**THERE, "PYTHONIOENCODING": "ascii"})
    assert "\u03c6" in json.loads(done.stdout.decode("utf-8"))["sentence"]
    with open("/dev/full", "w", encoding="utf-8") as full:
        command = [sys.executable, "-m", "icpshap", *arguments]
        done = subprocess.run(
            command,
            cwd=files,
            env=THERE,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 1
    assert done.stderr.startswith("icpshap: the output cannot be written")
    assert "Traceback" not in done.stderr


def test_a_missing_extra_is_said_before_anything_is_computed(files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    monkeypatch.delitem(sys.modules, "icpshap.report.page", raising=False)
    monkeypatch.delattr("icpshap.report.page", raising=False)
    monkeypatch.setitem(sys.modules, "jinja2", None)
    monkeypatch.setattr("icpshap.cli._scans", lambda given: pytest.fail("scans were read"))
    assert cli.main(["explain", "reference.npy", "source.npy", "--html", "a.html"]) == 1
    assert "pip install 'icpshap[plots]'" in capsys.readouterr().err


def test_a_registration_s_missing_extra_is_said(files, scans_given, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "libusb_package", None)
    arguments = ["explain", *scans_given, "--transform", str(files / "T.txt")]
    assert cli.main([*arguments, "--register", "open3d"]) == 1
    assert "pip install 'icpshap[formats]'" in capsys.readouterr().err


def test_what_the_causes_refer_to_can_be_given(files, scans_given, capsys):
    arguments = ["fit", *scans_given, "--transform", str(files / "T.txt")]
    assert cli.main([*arguments, "--perturbation", "overlap_distance=0.35"]) == 0
    assert "overlap_distance is 0.35 m" in capsys.readouterr().out
    assert cli.main([*arguments, "--perturbation", "overlap=0.35"]) == 1
    assert "perturbation: unknown key 'overlap'" in capsys.readouterr().err


def test_points_that_are_not_finite_are_left_out_where_that_is_asked_for(files, capsys):
    points = np.load(files / "source.npy")
    np.save(files / "holes.npy", np.vstack([np.full((7, 3), np.nan), points]))
    scans = [str(files / name) for name in ("reference.npy", "holes.npy")]
    assert cli.main(["fit", *scans, "--transform", str(files / "T.txt")]) == 1
    assert "--drop-non-finite" in capsys.readouterr().err
    found = icpshap.read_scan(files / "holes.npy", drop_non_finite=True)
    assert (found == icpshap.read_scan(files / "source.npy")).all()
    done = run(
        ["fit", *scans, "--transform", str(files / "T.txt"), "--drop-non-finite"], files, env=THERE
    )
    assert done.returncode == 0 and b"true pose" in done.stdout
    assert b"holes.npy: 7 points that are not finite are left out" in done.stderr


def test_quiet_says_nothing_not_even_whose_answer_is_the_truth(files):
    done = run(["explain", "reference.npy", "source.npy", *FAST, "--quiet"], files, env=THERE)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    done = run(["explain", "reference.npy", "source.npy", *FAST], files, env=THERE)
    assert b"registration itself answered" in done.stderr


def test_changes_of_the_command_line_may_be_texts(files, scans_given, capsys):
    arguments = ["explain", *scans_given, "--transform", str(files / "T.txt"), *FAST]
    arguments += ["--partial-overlap", "0", "--initial-pose", "1", "--json"]
    assert cli.main([*arguments, "--what-if"]) == 0
    tried = [row["what_if"] for row in json.loads(capsys.readouterr().out)["what_if"]]
    assert "more_neighbours" in tried
    assert cli.main([*arguments, "--what-if", "no reach: normal_neighbours=9"]) == 0
    tried = [row["what_if"] for row in json.loads(capsys.readouterr().out)["what_if"]]
    assert tried == ["as it is", "no reach"]
