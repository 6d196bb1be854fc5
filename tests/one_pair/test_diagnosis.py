"""What is wrong with one pair: by the function and by the command."""

import json

import corridors
import numpy as np
import pytest

import icpshap
from icpshap import cli
from icpshap.errors import DataError, UserError


def given(seed, noise=0.005):
    pair = corridors.pair(seed, noise=noise)
    return pair.reference, pair.source, pair.T_reference_source


HEALTHY = [given(seed) for seed in (1, 2, 3)]


@pytest.fixture(scope="module")
def diagnosed():
    return icpshap.diagnose(*given(0, noise=0.04), healthy=HEALTHY)


def test_noise_is_found(diagnosed):
    assert diagnosed.causes == ["sensor_noise"]
    assert diagnosed.levels["sensor_noise"] == pytest.approx(0.04, rel=0.2)
    assert diagnosed.levels["partial_overlap"] == 0
    assert diagnosed.sentence.startswith("Beside 3 other pairs sensor noise (σ = 0.0")
    assert repr(diagnosed) == diagnosed.sentence


def test_the_screen_says_what_is_told_and_what_is_hidden(diagnosed):
    text = diagnosed.to_text(80)
    assert "Not visible in" in text and "Weakest direction" in text
    assert max(map(len, text.splitlines())) <= 80


def test_json_holds_everything(diagnosed):
    found = json.loads(diagnosed.to_json())
    assert found["sentence"] == diagnosed.sentence
    assert found["healthy_pairs"] == 3 and found["verdict"] == "found"


def test_the_same_call_gives_the_same_table(diagnosed):
    again = icpshap.diagnose(*given(0, noise=0.04), healthy=HEALTHY)
    assert again.table.equals(diagnosed.table)


def test_without_anything_to_compare_no_number_is_called_unusual():
    found = icpshap.diagnose(*given(0))
    assert found.causes == [] and "nothing can be called unusual" in found.sentence
    assert json.loads(found.to_json())["level_sensor_noise"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sensor": "eyes"}, "sensor: 'eyes', expected one of hokuyo_utm_30lx"),
        ({"sensor": "velodyne_vlp_16", "healthy": HEALTHY}, "given with healthy pairs"),
        ({"healthy": [HEALTHY[0][:1]]}, "healthy: entry 0 has 1 parts, expected"),
        ({"healthy": None}, "healthy: NoneType, expected a list of pairs"),
        ({"healthy": [None]}, "healthy: entry 0 is no pair, expected"),
        ({"clean_runs": True, "estimator": "closed_form"}, "closed_form returns no pose samples"),
        ({"healthy": [given(0)]}, "healthy 0: the pair that is diagnosed, expected another one"),
    ],
)
def test_what_cannot_be_used_is_said(arguments, message):
    with pytest.raises(UserError, match=message):
        icpshap.diagnose(*given(0), **arguments)


def test_scans_without_any_noise_have_json_too():
    found = icpshap.diagnose(*given(0, noise=0.0), sensor="velodyne_vlp_16")
    assert found.table.plane_residual[0] == pytest.approx(0, abs=1e-9)
    assert json.loads(found.to_json())["z_sensor_noise"] < 0


def test_of_a_sheet_that_says_an_accuracy_that_is_said():
    vague, exact = (
        icpshap.diagnose(*given(0), sensor=name) for name in ("velodyne_vlp_16", "hokuyo_utm_30lx")
    )
    assert "VLP-16 an accuracy is published" in " ".join(vague.to_text().split())
    assert exact.sheet == "" and "the noise does not stand out" in exact.sentence


def test_scans_that_do_not_overlap_cannot_be_measured():
    reference, source, _ = given(0)
    away = np.eye(4)
    away[2, 3] = 60.0
    with pytest.raises(DataError, match="nothing can be measured"):
        icpshap.diagnose(reference, source, away)


def test_clean_runs_are_those_of_an_explanation():
    estimator = {"based_on": "paper", "runs": 50, "subsampling_probability": 0.02}
    found = icpshap.diagnose(*given(0), estimator=estimator, clean_runs=True)
    explained = icpshap.explain(*given(0), causes={"initial_pose": 2.0}, estimator=estimator)
    clean = explained.tables["shap"].filter(regex="^clean_wrong_basin_share").iloc[0]
    assert found.clean_runs == (50, *clean)
    assert json.loads(found.to_json())["clean_runs"]["number"] == 50
    assert "Of 50 clean runs" in found.to_text(500)
    assert icpshap.diagnose(*given(0)).clean_runs is None


def test_the_command_prints_the_same(tmp_path, capsys):
    reference, source, T = given(0, noise=0.04)
    np.save(tmp_path / "a.npy", reference)
    np.save(tmp_path / "b.npy", source)
    np.savetxt(tmp_path / "T.txt", T)
    typed = [
        str(tmp_path / "a.npy"),
        str(tmp_path / "b.npy"),
        "--transform",
        str(tmp_path / "T.txt"),
    ]
    assert cli.main(["diagnose", *typed, "--sensor", "hokuyo_utm_30lx", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    expected = icpshap.diagnose(reference, source, T, sensor="hokuyo_utm_30lx")
    assert found["z_sensor_noise"] == expected.table.z_sensor_noise[0]
    assert cli.main(["diagnose", *typed]) == 0
    assert "nothing can be called unusual" in " ".join(capsys.readouterr().out.split())


def test_the_command_takes_the_pose_of_a_healthy_pair(tmp_path, capsys, monkeypatch):
    typed = []
    for name, (reference, source, T) in (("a", given(0, noise=0.04)), ("b", HEALTHY[0])):
        np.save(tmp_path / f"{name}0.npy", reference)
        np.save(tmp_path / f"{name}1.npy", source)
        np.savetxt(tmp_path / f"{name}.txt", T)
        typed.append([str(tmp_path / f"{name}{k}.npy") for k in (0, 1)])
    monkeypatch.chdir(tmp_path)
    first = ["diagnose", *typed[0], "--transform", "a.txt", "--json"]
    expected = icpshap.diagnose(*given(0, noise=0.04), healthy=HEALTHY[:1]).to_json()
    numbers = [f"{number:.17g}" for number in HEALTHY[0][2].reshape(-1)]
    for pose in (["b.txt"], numbers):
        assert cli.main([*first, "--healthy", *typed[1], *pose]) == 0
        assert json.loads(capsys.readouterr().out) == json.loads(expected)
    assert cli.main([*first, "--healthy", "b0.npy"]) == 1
    assert "--healthy b0.npy: expected two scans" in capsys.readouterr().err
