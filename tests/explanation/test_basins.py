"""Which runs are in a wrong basin."""

import numpy as np

from icpshap.explanation.basins import wrong_basin


def test_wrong_basin_is_measured_from_the_median():
    xi = np.zeros((2, 9, 6))
    xi[:] = [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]
    xi[0, 0, 3:] += [0.08, 0.08, 0.0]  # 0.113 m
    xi[0, 1, 3] += 0.099
    xi[1, 2, 0] += np.deg2rad(2.1)
    xi[1, 3, 1] -= np.deg2rad(1.9)
    xi[1, 4] = np.nan
    marks = wrong_basin(xi, 0.1, np.deg2rad(2.0))
    assert np.argwhere(marks).tolist() == [[0, 0], [1, 2]]


def test_wrong_basin_of_a_setting_that_failed_altogether():
    assert not wrong_basin(np.full((5, 6), np.nan), 0.1, 0.1).any()
