"""One pair of a simulated room, explained once."""

import pytest

import icpshap
from icpshap import se3
from icpshap.data import simulate


@pytest.fixture(scope="session")
def options():
    """An estimator that is soon done."""
    return {"based_on": "paper", "runs": 60, "subsampling_probability": 0.3}


@pytest.fixture(scope="session")
def scans():
    """Two scans (n, 3) of a room and the true T_reference_source."""
    T = simulate.simulate_poses("apartment", 2, seed=1)
    clouds = [simulate.simulate_scan("apartment", k, T[k], 3000, 1) for k in range(2)]
    return (*clouds, se3.inverse(T[0]) @ T[1])


@pytest.fixture(scope="session")
def explained(scans, options):
    return icpshap.explain(*scans, estimator=options, what_if={"more": {"runs": 80}})
