"""Fixtures: configurations, small clouds, and data that are only at hand where they are named."""

import copy
import os
from pathlib import Path

import numba
import numpy as np
import pytest
import yaml

from icpshap import config as configuration
from icpshap import se3
from icpshap.data.pair import Pair

REPOSITORY = Path(__file__).parent.parent
# Tests, and the workflows that they run, compile the ICP engine once.
numba.config.CACHE_DIR = str(REPOSITORY / ".cache" / "numba")
os.environ.setdefault("NUMBA_CACHE_DIR", numba.config.CACHE_DIR)

# Files that take longest go first, so that neither process waits for the other at the end.
LONGEST_FIRST = ("test_faults.py", "test_workflow.py", "test_learned_workflow.py", "test_pinned.py")

PAPER_CONFIG = yaml.safe_load((REPOSITORY / "config.yaml").read_text())


def pytest_collection_modifyitems(items):
    ranks = {name: rank for rank, name in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: ranks.get(item.path.name, len(ranks)))


def folder_in(variable):
    """Folder that an environment variable names; the test is skipped where there is none."""
    if not os.environ.get(variable):
        pytest.skip(f"{variable} names no folder")
    folder = Path(os.environ[variable])
    assert folder.is_dir(), f"{variable} names {folder}, which is no folder"
    return folder.resolve()


@pytest.fixture
def real_data():
    return folder_in("ICPSHAP_REAL_DATA")


@pytest.fixture
def oracle():
    return folder_in("ICPSHAP_ORACLE")


@pytest.fixture
def estimator_oracle():
    return folder_in("ICPSHAP_ESTIMATOR_ORACLE")


@pytest.fixture
def config():
    """The paper's configuration, to be changed by a test."""
    return copy.deepcopy(PAPER_CONFIG)


@pytest.fixture(scope="session")
def paper():
    return configuration.load(PAPER_CONFIG)


@pytest.fixture(scope="session")
def room_pair():
    """Two clouds of the corner of a room, 3,000 points each, nothing nearer than 1 m."""
    generator = np.random.default_rng(3)

    def cloud(count):
        points = generator.uniform([1.5, 1.5, 1.2], [5.0, 4.0, 3.5], (count, 3))
        wall = generator.integers(0, 3, count)
        points[np.arange(count), wall] = np.array([5.0, 4.0, 3.5])[wall]
        return points

    T_reference_source = se3.exp([0.02, -0.05, 0.1, 0.3, -0.2, 0.1])
    reference = cloud(3000)
    source = se3.transform(se3.inverse(T_reference_source), cloud(3000))
    return Pair.measured(reference, source, T_reference_source, 0.2)
