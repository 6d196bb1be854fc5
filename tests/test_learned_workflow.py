"""An estimator that learns from another experiment, as a user runs both."""

from itertools import permutations

import numpy as np
import pandas as pd
import pytest
import yaml
from project import TINY, Project

from icpshap import se3
from icpshap.tables import DESCRIPTOR

RUN = ["taught", "again"]


def write_sequence(folder, scans, seed):
    """Scans of the corner of a room, 1,500 points each, from places near one another."""
    folder.mkdir()
    generator = np.random.default_rng(seed)
    poses = se3.exp(generator.normal(scale=0.05, size=(scans, 6)))
    for index, T_global_scan in enumerate(poses):
        points = generator.uniform([1.5, 1.5, 1.2], [5.1, 4.1, 3.6], (1500, 3))
        wall = generator.integers(0, 3, len(points))
        points[np.arange(len(points)), wall] = np.array([5.1, 4.1, 3.6])[wall]
        points = se3.transform(se3.inverse(T_global_scan), points)
        points += generator.normal(scale=0.01, size=points.shape)
        frame = pd.DataFrame(points, columns=list("xyz"))
        frame.to_csv(folder / f"scan_{index}.csv", index=False)
    np.savetxt(folder / "poses.txt", poses[:, :3].reshape(scans, 12))


def pairs(sequence, scans):
    return [
        {"sequence": sequence, "reference": i, "source": j}
        for i, j in permutations(range(scans), 2)
    ]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """Six scans are 30 pairs to learn from, for the two of another sequence."""
    project = Project(tmp_path_factory.mktemp("learned"))
    config = yaml.safe_load(TINY.read_text())
    config["data"] = {}
    for seed, (name, scans) in enumerate((("mine", 2), ("others", 6))):
        write_sequence(project.folder / name, scans, seed)
        config["data"][name] = {"scans": scans, "folder": {"path": name}}
    config["estimators"]["tiny"] |= {"runs": 50, "maximum_iterations": 10}
    config["estimators"]["learning"] = {"kind": "learned", "training": "taught"}
    taught = {
        "estimator": "tiny",
        "pairs": pairs("others", 6) + pairs("mine", 2)[:1],
        "instances": {"fixed": {"sensor_noise": 0.05}},
        "figures": [],
    }
    again = {"based_on": "taught", "estimator": "learning", "pairs": pairs("mine", 2)}
    config["experiments"] = {"taught": taught, "again": again}
    config |= {"sequences": list(config["data"]), "run": RUN, "runs_per_job": 10_000}
    (project.folder / "tiny.yaml").write_text(yaml.safe_dump(config))
    project.tiny("--", "results/again/shap.parquet")
    return project


@pytest.mark.slow
def test_pairs_have_a_covariance_learned_from_the_other_sequence(finished):
    results = finished.folder / "results"
    shap = pd.read_parquet(results / "again" / "shap.parquet")
    assert len(shap) == 2 and (shap["reason"] == "").all()
    assert (shap["phi_sensor_noise"] > 1).all()
    examples = pd.read_parquet(results / "taught" / "others" / "descriptors.parquet")
    assert len(examples) == 2 * 30
    assert examples[DESCRIPTOR].notna().all(axis=None)
    assert not (results / "taught" / "mine" / "descriptors.parquet").exists()
    estimates = pd.read_parquet(results / "again" / "mine" / "estimates" / "0.parquet")
    assert set(estimates["status"]) == {"ok"}


@pytest.mark.slow
def test_a_second_run_has_nothing_to_do(finished):
    assert "Nothing to be done" in finished.tiny("--", "results/again/shap.parquet")


@pytest.mark.slow
def test_examples_that_are_lost_come_back_as_they_were(finished):
    before = finished.digests("results/again/mine/estimates/*.parquet")
    examples = finished.digests("results/taught/others/descriptors.parquet")
    for path in [*before, *examples]:
        (finished.folder / path).unlink()
    finished.tiny("--", *before)
    assert finished.digests("results/again/mine/estimates/*.parquet") == before
    assert finished.digests("results/taught/others/descriptors.parquet") == examples


@pytest.mark.slow
def test_another_training_estimates_again(finished):
    config = yaml.safe_load((finished.folder / "tiny.yaml").read_text())
    config["estimators"]["tiny"]["maximum_iterations"] = 11
    (finished.folder / "other.yaml").write_text(yaml.safe_dump(config))
    planned = finished.planned("--configfile", "other.yaml", "--", "results/again/shap.parquet")
    assert planned["train_estimator"] == 1 and planned["estimate_covariances"] == 1
