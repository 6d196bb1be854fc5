"""What is diagnosed of each pair, explained: the whole workflow on pairs of a corridor.

One pair is noisy, and of one a part of the source is hidden.
"""

import shutil

import numpy as np
import pandas as pd
import planted_corridors
import pytest
import yaml
from conftest import REPOSITORY
from project import Project

import icpshap
from icpshap import cli, tables

CONFIG = REPOSITORY / "tests" / "tiny_here.yaml"
pytestmark = pytest.mark.slow
NAMES = ["sensor_noise", "initial_pose", "partial_overlap", "under_constrained"]
TINY = yaml.safe_load(CONFIG.read_text())["estimators"]["tiny"]
TINY = {key: value for key, value in TINY.items() if key != "based_on"}
TABLES = ("shap", "uncertainty", "directions", "covariances")


def project_in(folder):
    shutil.copy(CONFIG, folder)
    return Project(folder)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    project = project_in(tmp_path_factory.mktemp("here"))
    planted_corridors.write(project.folder / "corridor")
    project.planned_before = project.planned("--configfile", "tiny_here.yaml")
    project.said = project.run("--configfile", "tiny_here.yaml")
    return project


@pytest.fixture(scope="module")
def shap(finished):
    return pd.read_parquet(finished.folder / "results/tiny_here/shap.parquet")


@pytest.fixture(scope="module")
def noisy(shap):
    return shap.iloc[planted_corridors.NOISY]


def test_jobs_are_known_before_there_are_data(finished):
    assert finished.planned_before["run_icp"] == 2
    assert finished.planned_before["find_instances"] == 1
    assert "Nothing to be done" in finished.run("--configfile", "tiny_here.yaml")


def test_what_was_planted_is_explained_and_nothing_else(shap, noisy):
    hidden = shap.iloc[planted_corridors.HIDDEN]
    others = shap.drop(index=[planted_corridors.NOISY, planted_corridors.HIDDEN])
    for row, planted in ((noisy, "sensor_noise"), (hidden, "partial_overlap")):
        removals = row[[f"removal_{name}" for name in NAMES]]
        assert removals.astype(float).idxmax() == f"removal_{planted}"
        assert row[f"removal_{planted}_low"] > 0
        assert (row.played_reference, row.played_source) != (row.reference, row.source)
    assert noisy.sensor_noise == pytest.approx(planted_corridors.SIGMA, rel=0.1)
    assert others.reason.eq("nothing stands out beside the other pairs").all()
    assert others.f.isna().all() and (others.played_reference == -1).all()


def test_a_cause_that_was_not_found_has_no_part_exactly(noisy):
    for name in ("partial_overlap", "under_constrained"):
        for number in (f"phi_{name}", f"removal_{name}"):
            ends = [noisy[f"{number}{end}"] for end in ("", "_low", "_high")]
            assert noisy[name] == 0 and ends == [0, 0, 0]


def test_each_setting_is_run_once(finished):
    runs = pd.concat(map(pd.read_parquet, finished.folder.glob("results/*/*/runs/*.parquet")))
    settings = runs.groupby(["reference", "source", *NAMES, "again", "noise_draw"]).size()
    assert (settings == 20).all() and len(settings) == 2 * 5 * 3
    assert set(runs.played_reference) == {0}


def test_the_game_is_that_of_the_healthy_pair_by_hand(finished, noisy):
    scans = [icpshap.read_scan(finished.folder / f"corridor/scan_0{k}.xyz") for k in (0, 1)]
    T = tables.read_poses(finished.folder / "resources/corridor/poses.parquet")[1]
    by_hand = icpshap.explain(
        *scans,
        T,
        causes={name: float(noisy[name]) for name in NAMES},
        estimator=icpshap.PAPER.with_options(overlap_shape="sector", **TINY),
        seed=42,
        name="corridor",
        indices=(0, 1),
    )
    found = by_hand.tables["shap"].iloc[0]
    numbers = [c for c in found.index if isinstance(found[c], float)]
    np.testing.assert_array_equal(noisy[numbers].astype(float), found[numbers].astype(float))


def test_another_cut_into_jobs_gives_the_same_bytes(finished, tmp_path):
    other = project_in(tmp_path)
    shutil.copytree(finished.folder / "corridor", tmp_path / "corridor")
    targets = [f"results/tiny_here/{name}.parquet" for name in TABLES]
    other.run("--configfile", "tiny_here.yaml", "--config", "runs_per_job=700", "--", *targets)
    assert len(other.digests("results/*/*/runs/*.parquet")) > 3
    expected = finished.digests("results/tiny_here/*.parquet")
    for path, digest in other.digests("results/tiny_here/*.parquet").items():
        assert digest == expected[path]


def test_report_and_console_say_what_was_found_and_where_it_was_played(finished):
    page = (finished.folder / "results/report.html").read_text()
    for said in (finished.said, page):
        assert "2 of 6 pairs of Corridor, at the diagnosed levels" in said
        assert "played on the most usual other pair (Corridor 0–1)" in said
        assert "f of Corridor 2–3 falls most without sensor noise" in said
        assert "that needs new scans, and its effect is predicted, from the game on" in said
    assert "What was found here, and how much it matters" in page
    assert "Pairs that were not registered" not in page


def test_its_covariances_are_not_exported_as_those_of_the_pairs(finished, capsys):
    path = finished.folder / "results/tiny_here/covariances.parquet"
    assert cli.main(["export", str(path), "--to", "g2o"]) == 1
    assert "whose runs are of other pairs than those that are explained" in capsys.readouterr().err


def test_another_diagnosis_plans_all_again(finished):
    changed = finished.planned("--configfile", "tiny_here.yaml", "--config", "seed=7")
    assert {"diagnose_pairs", "find_instances", "join_pairs", "run_icp"} <= set(changed)


def test_what_is_finished_so_far_is_the_same(finished, shap):
    said = finished.run("so_far", "--nolock", "--configfile", "tiny_here.yaml")
    assert "tiny_here/corridor: 6 of 6 pairs" in said
    so_far = pd.read_parquet(finished.folder / "results/so_far/tiny_here/corridor/shap.parquet")
    pd.testing.assert_frame_equal(so_far, shap, check_exact=True)
