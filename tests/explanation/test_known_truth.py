"""The whole workflow with an estimator whose truth is known: one more file of the library."""

import itertools
import shutil

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import REPOSITORY
from known_runs import OFF, true_game
from project import TINY, Project

from icpshap.explanation import shapley

SCANS = 7
PERTURBATION = [0.05, 1.5, 0.05]  # of which known_runs.true_game is the game
PHI = [f"phi_{name}" for name in OFF]


def project_with_known_estimator(folder):
    """Seven small scans, and an experiment on each of their 21 pairs, with other random numbers."""
    project = Project(folder)
    (folder / "code").mkdir()
    project = project.with_copied_code(folder / "code")
    for file, place in (
        ("known_estimator", "icpshap/estimators/known"),
        ("known_runs", "known_runs"),
    ):
        shutil.copy(REPOSITORY / "tests" / f"{file}.py", project.code / f"{place}.py")
    (folder / "scans").mkdir()
    generator = np.random.default_rng(0)
    for index in range(SCANS):
        points = pd.DataFrame(generator.uniform(2.0, 3.0, (1000, 3)), columns=list("xyz"))
        points.to_csv(folder / "scans" / f"scan_{index}.csv", index=False)
    (folder / "scans" / "poses.txt").write_text(SCANS * "1 0 0 0 0 1 0 0 0 0 1 0\n")
    pairs = [
        {"sequence": "cubes", "reference": i, "source": j}
        for i, j in itertools.combinations(range(SCANS), 2)
    ]
    config = {
        "sequences": ["cubes"],
        "run": ["known"],
        "data": {"cubes": {"scans": SCANS, "folder": {"path": "scans"}}},
        "estimators": {"known": {"kind": "known"}},
        "experiments": {
            "known": {
                "estimator": "known",
                "pairs": pairs,
                "instances": {"fixed": dict(zip(OFF, PERTURBATION, strict=True))},
                "figures": ["summary"],
            }
        },
    }
    (folder / TINY.name).write_text(yaml.safe_dump(config))
    return project


@pytest.mark.slow
def test_intervals_of_the_workflow_hold_the_truth_at_the_nominal_rate(tmp_path):
    project_with_known_estimator(tmp_path).tiny()
    table = pd.read_parquet(tmp_path / "results" / "known" / "shap.parquet")
    assert len(table) == 21
    truth = shapley.shapley_values(true_game())
    low, high = (table[[f"{phi}_{end}" for phi in PHI]].to_numpy() for end in ("low", "high"))
    inside = (low <= truth) & (truth <= high)
    assert 54 <= np.count_nonzero(inside) < inside.size  # 0.95 of them are 60
    assert (tmp_path / "results" / "known" / "figures" / "summary.png").is_file()
    assert (tmp_path / "results" / "report.html").is_file()
