"""Games of 1, 2, 5 and 7 causes, and an estimator of covariances, from scans to the report."""

import shutil

import pandas as pd
import pytest
import yaml
from conftest import REPOSITORY
from project import Project

from icpshap.explanation import shapley

PLAYERS = {
    1: ["rounding"],
    2: ["blind_side", "offset"],
    5: ["rounding", "sensor_noise", "initial_pose", "partial_overlap", "fewer_points"],
    7: [
        "rounding",
        "sensor_noise",
        "initial_pose",
        "partial_overlap",
        "blind_side",
        "fewer_points",
        "offset",
    ],
}
LEVELS = {
    "rounding": 0.05,
    "sensor_noise": 0.05,
    "initial_pose": 1.5,
    "partial_overlap": 0.05,
    "blind_side": 0.3,
    "fewer_points": 2,
    "offset": 0.05,
}
CONSTANT = '''"""The same covariance whatever the data say, and twice of it where there is noise."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from icpshap.estimators.kind import COVARIANCES, Covariance, Kind


@dataclass(frozen=True)
class Constant(Kind):
    """Made for the test."""

    name: ClassVar = "constant"
    returns: ClassVar = COVARIANCES

    def estimate(self, group):
        for start in group.starts:
            noisy = start.setting.values["sensor_noise"] > 0
            T = group.pair.T_reference_source
            covariance = 1e-4 * (1 + noisy) * np.eye(6)
            yield Covariance(start.setting, group.noise_draw, T, covariance)
'''

pytestmark = pytest.mark.slow


def experiment(names):
    """A fixed instance of these causes on the pair of the tiny room."""
    fixed = {name: LEVELS[name] for name in reversed(names)}
    return {
        "estimator": "fast",
        "pairs": [{"sequence": "tiny_room", "reference": 0, "source": 1}],
        "instances": {"fixed": fixed},
        "figures": ["summary", "waterfall", "dependence", "interactions", "pairs"],
        "dependence": [[names[0], names[-1]]] if len(names) > 1 else [],
    }


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    project = Project(tmp_path_factory.mktemp("any_size"))
    project = project.with_copied_code(tmp_path_factory.mktemp("code"))
    made = project.code / "icpshap"
    shutil.copy(REPOSITORY / "tests" / "made_causes.py", made / "causes" / "made.py")
    (made / "estimators" / "constant.py").write_text(CONSTANT)
    experiments = {f"of_{number}": experiment(names) for number, names in PLAYERS.items()}
    experiments["of_2"]["scenes"] = experiments["of_2"]["pairs"]
    experiments["of_covariances"] = {
        **experiment(["sensor_noise", "partial_overlap"]),
        "estimator": "constant",
        "scenes": experiments["of_2"]["pairs"],
    }
    fast = {"based_on": "tiny", "runs": 50, "subsampling_probability": 0.1, "maximum_iterations": 8}
    overlay = {
        "sequences": ["tiny_room"],
        "run": list(experiments),
        "runs_per_job": 2000,
        "estimators": {"fast": fast, "constant": {"kind": "constant"}},
        "experiments": experiments,
    }
    (project.folder / "any_size.yaml").write_text(yaml.safe_dump(overlay, sort_keys=False))
    project.said = project.run("--configfile", "tiny.yaml", "any_size.yaml")
    return project


@pytest.mark.parametrize("number", PLAYERS)
def test_a_game_of_any_size_is_explained_and_drawn(finished, number):
    results = finished.folder / "results" / f"of_{number}"
    table = pd.read_parquet(results / "shap.parquet")
    names = PLAYERS[number]
    phi = [name for name in table if name.startswith("phi_") and name.endswith("_significant")]
    assert phi == [f"phi_{name}_significant" for name in names]
    row = table.iloc[0]
    assert row["f"] == pytest.approx(sum(row[f"phi_{name}"] for name in names))
    couples = [f"interaction_{a}_{b}" for a, b in shapley.couples(names)]
    assert all(couple in table for couple in couples)
    assert len(pd.read_parquet(results / "uncertainty.parquet")) == 2**number + 1
    figures = ["summary", "waterfall", "interactions", "pairs"]
    figures += [f"dependence_{names[0]}_by_{names[-1]}"] if number > 1 else []
    for figure in figures:
        for kind in ("png", "svg", "txt"):
            assert (results / "figures" / f"{figure}.{kind}").stat().st_size > 0
    captions = "".join(path.read_text() for path in results.glob("figures/*.txt"))
    others = set(LEVELS) - set(names)
    assert not [name for name in others if name.replace("_", " ") in captions]


def test_covariances_go_all_the_way_to_the_report(finished):
    results = finished.folder / "results"
    row = pd.read_parquet(results / "of_covariances" / "shap.parquet").iloc[0]
    assert row["phi_sensor_noise"] == pytest.approx(row["f"])
    assert row["f"] > 0.5 and row["phi_partial_overlap"] == 0
    assert row["interval_over"] == "" and "deterministic" in row["no_interval"]
    assert not list((results / "of_covariances").glob("*/runs"))
    (path,) = (results / "of_covariances" / "tiny_room" / "estimates").glob("*.parquet")
    assert len(pd.read_parquet(path)) == 2**2 + 1
    text = (results / "of_covariances" / "figures" / "waterfall.txt").read_text()
    assert "deterministic" in text
    for word in ("ICP runs", "wrong basin", "A/A", "distinguished from zero"):
        assert word not in text
    assert (results / "report.html").is_file()
    assert "estimate_covariances of_covariances tiny_room 0" in finished.said
