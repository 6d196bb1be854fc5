"""The function, the command and the workflow say the same of a pair, to the byte."""

import os
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import REPOSITORY
from project import Project

import icpshap
from icpshap import tables
from icpshap.causes import CAUSES

LEVELS = {"sensor_noise": 0.03, "initial_pose": 1.5, "partial_overlap": 0.05}
OPTIONS = {"runs": 60, "voxel_size": 0.1, "subsampling_probability": 0.4}
TABLES = ("fit", "uncertainty", "shap", "directions", "covariances")


@pytest.fixture(scope="module")
def files(scans, tmp_path_factory):
    """A folder with two scans and the transform between them."""
    folder = tmp_path_factory.mktemp("same")
    (folder / "scans").mkdir()
    for index, points in enumerate(scans[:2]):
        np.save(folder / "scans" / f"scan_{index}.npy", points)
    np.savetxt(folder / "scans" / "transform.txt", scans[2])
    return folder


@pytest.fixture(scope="module")
def explained(files):
    scans = [icpshap.read_scan(files / "scans" / f"scan_{index}.npy") for index in (0, 1)]
    T = np.loadtxt(files / "scans" / "transform.txt")
    return icpshap.explain(*scans, T, causes=LEVELS, estimator=OPTIONS, seed=7, threads=2)


def test_as_the_workflow(files, explained):
    project = Project(files)
    experiment = {
        "estimator": "mine",
        "pairs": [{"sequence": "pair", "reference": 0, "source": 1}],
        "instances": {"fixed": LEVELS},
        "figures": [],
    }
    config = {
        "seed": 7,
        "sequences": ["pair"],
        "run": ["one"],
        "runs_per_job": 100,
        "data": {"pair": {"scans": 2, "folder": {"path": "scans", "poses": "transform.txt"}}},
        "estimators": {"mine": {"based_on": "lidar", **OPTIONS}},
        "experiments": {"one": experiment},
    }
    (files / "one.yaml").write_text(yaml.safe_dump(config))
    targets = [f"results/one/pair/{name}.parquet" for name in TABLES]
    project.run("--configfile", "one.yaml", "--", *targets)
    results = files / "results" / "one" / "pair"
    for name in TABLES:
        found = pd.read_parquet(results / f"{name}.parquet")
        table = explained.tables[name][list(found.columns)].astype(found.dtypes)
        pd.testing.assert_frame_equal(table, found, check_exact=True)
    table = tables.read(results / "covariances.parquet", "covariances")
    for covariance, on in ((explained.covariance, True), (explained.covariance_clean, False)):
        levels = LEVELS if on else {name: CAUSES[name].off for name in LEVELS}
        row = table[~table.again & (table[list(levels)] == pd.Series(levels)).all(axis=1)]
        assert tables.covariances(row)[0].tobytes() == covariance.matrix.tobytes()
    runs = pd.concat(pd.read_parquet(path) for path in sorted((results / "runs").iterdir()))
    poses = [f"T_{row}{column}" for row in range(4) for column in range(4)]
    assert (runs[poses].to_numpy() == explained.tables["runs"][poses].to_numpy()).all()


def test_as_the_command(files, explained):
    command = [sys.executable, "-m", "icpshap", "explain", "scans/scan_0.npy", "scans/scan_1.npy"]
    command += ["--transform", "scans/transform.txt", "--seed", "7", "--save", "pair.zip"]
    command += ["--sensor-noise", "0.03", "--threads", "1", "--quiet"]
    for name, value in OPTIONS.items():
        command += ["--option", f"{name}={value}"]
    found_there = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    done = subprocess.run(
        command, cwd=files, env=found_there, capture_output=True, text=True, check=True
    )
    assert done.stdout == ""
    saved = icpshap.Explanation.load(files / "pair.zip")
    assert saved.to_json() == explained.to_json()
    for name, table in saved.tables.items():
        expected = explained.tables[name]
        pd.testing.assert_frame_equal(table, expected, check_exact=True, check_dtype=False)
