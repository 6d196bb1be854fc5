"""Fixtures of the report's tests: tables, and more causes and estimators than are shipped."""

import matplotlib.pyplot as plt
import pytest
from known_results import FIXED, PAIRS, plugged_in, shap_table


@pytest.fixture(autouse=True)
def registries():
    with plugged_in():
        yield


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


@pytest.fixture
def grid():
    return shap_table()


@pytest.fixture
def fixed():
    return shap_table(FIXED, PAIRS)
