"""The numbers of `paper` and `released_code`: pinned for good, on the tiny workflow.

Poses, f, phi and interactions with every run kept may never change. Bytes differ between kinds of
processor (exp, log, sin), so the repository pins to 1e-9 relative, ends of intervals to 6e-8, on
scans that lie beside the pins.

    python -m tests.test_pinned FOLDER    writes the pins from the results in a working directory
"""

import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from project import Project

PINS = Path(__file__).parent / "pinned"
EXPERIMENTS = ("tiny_grid", "tiny_fixed", "tiny_grid_released", "tiny_fixed_released")
CAUSES = ["sensor_noise", "initial_pose", "partial_overlap"]
PAIR = ["reference", "source"]
RUNS = [0, 29, 59]  # of which the poses are pinned
TOLERANCE = 1e-9
# The jackknife takes n - 1 times one mean from n times another, so it magnifies rounding n times.
TOLERANCE_OF_ENDS = 60 * TOLERANCE


def poses(folder, experiment):
    """Poses, iterations and status of some runs of every setting."""
    paths = sorted((folder / "results" / experiment).glob("*/runs/*.parquet"))
    parts = [pd.read_parquet(path).assign(sequence=path.parts[-3]) for path in paths]
    table = pd.concat(parts)
    table = table[table["run"].isin(RUNS)]
    keys = ["sequence", *PAIR, *CAUSES, "again", "run"]
    xi = [f"xi_{k}" for k in range(6)]
    columns = [*keys, *xi, *(f"initial_{name}" for name in xi), "iterations", "status"]
    return table[columns].sort_values(keys).reset_index(drop=True)


def values(folder, experiment):
    """f, phi and interactions of every instance with every run kept, and the A/A value."""
    table = pd.read_parquet(folder / "results" / experiment / "shap.parquet")
    phi = [f"phi_{cause}" for cause in CAUSES]
    couples = [name for name in table if name.startswith("interaction_") and name[-4:] != "_low"]
    couples = [name for name in couples if not name.endswith("_high")]
    kept = [f"{name}_all" for name in ("f", *phi)]
    return table[["sequence", *PAIR, *CAUSES, "f", *phi, *couples, *kept, "f_again"]]


def uncertainty(folder, experiment):
    table = pd.read_parquet(folder / "results" / experiment / "uncertainty.parquet")
    return table[["sequence", *PAIR, *CAUSES, "again", "f", "f_low", "f_high", "kl", "logdet"]]


TABLES = {"poses": poses, "values": values, "uncertainty": uncertainty}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    project = Project(tmp_path_factory.mktemp("pinned"))
    shutil.copytree(PINS / "scans", project.folder / "scans")
    targets = [
        f"results/{name}/{t}.parquet" for name in EXPERIMENTS for t in ("shap", "uncertainty")
    ]
    pinned = str(Path(__file__).parent / "pinned.yaml")
    project.run("--configfile", "tiny.yaml", pinned, "--", *targets)
    return project.folder


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_numbers_are_those_that_were_pinned(made, experiment, table):
    found = TABLES[table](made, experiment)
    expected = pd.read_csv(PINS / f"{experiment}_{table}.csv")
    assert list(found) == list(expected) and len(found) == len(expected)
    for name in expected:
        one, other = found[name].to_numpy(), expected[name].to_numpy()
        if one.dtype == float:
            relative = TOLERANCE_OF_ENDS if name.endswith(("_low", "_high")) else TOLERANCE
            scale = np.nanmax(np.abs(other), initial=0.0)
            np.testing.assert_allclose(one, other, relative, relative * scale, err_msg=name)
        else:
            assert (one == other).all(), name


def write(folder):
    PINS.mkdir(exist_ok=True)
    for experiment in EXPERIMENTS:
        for name, table in TABLES.items():
            path = PINS / f"{experiment}_{name}.csv"
            table(Path(folder), experiment).to_csv(path, index=False, float_format="%.17g")


if __name__ == "__main__":
    write(sys.argv[1])
