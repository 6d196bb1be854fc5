"""What the tests of the estimators that draw samples share."""

from pathlib import Path

import numpy as np
from conftest import folder_in

from icpshap import estimators, icp
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Perturbation, Streams
from icpshap.plan import Setting

NAMES = ("sensor_noise", "initial_pose", "partial_overlap")
STREAMS = Streams(seed=1, sequence="room", reference=0, source=1)
DEVIATION = Perturbation().deviation
CLEAN, NOISY, SPREAD, REDUCED = (
    Setting.at(dict(zip(NAMES, values, strict=True)))
    for values in [(0.0, 1.0, 0.0), (0.05, 1.0, 0.0), (0.0, 2.0, 0.0), (0.0, 1.0, 0.1)]
)
SETTINGS = [CLEAN, NOISY, SPREAD, REDUCED]


def runs(pair, settings, kind, deviation=DEVIATION, **values):
    """The table of runs of a kind with some options, of all usable points."""
    estimator = Estimator.of(kind, {"subsampling_probability": 1.0, **values}).of_causes(NAMES)
    return estimators.estimate(pair, settings, estimator, deviation, STREAMS)[0]


def of(table, setting):
    """The runs of a setting."""
    on = (table[list(setting.values)] == list(setting.values.values())).all(axis=1)
    return table[on].reset_index(drop=True)


def expected(name):
    """Arrays of the oracle of estimators; the test is skipped where there is none."""
    return np.load(folder_in("ICPSHAP_ESTIMATOR_ORACLE") / name)


def clouds(coalition):
    """Reference and source (n, 3) of the oracle's pair beyond 1 m in a coalition such as "101"."""
    folder = folder_in("ICPSHAP_ORACLE")
    kind = "noisy" if coalition[0] == "1" else "clean"
    reference, source = (_load(folder, f"{scan}_{kind}.npy") for scan in ("P1", "P2"))
    usable = icp.minimum_range(source, 1.0)
    if coalition[2] == "1":
        usable &= np.load(folder / "inputs.npz")["P2_keep"]
    return reference[icp.minimum_range(reference, 1.0)], source[usable]


def _load(folder, name):
    return np.load(Path(folder, name)).astype(float)
