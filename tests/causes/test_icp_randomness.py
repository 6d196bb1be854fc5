"""Fewer points of a run, at random: nested, and with the variance of a thinner subsample."""

import numpy as np
import pytest

from icpshap.causes.icp_randomness import IcpRandomness
from icpshap.estimators.perturb import Streams, subsample

STREAMS = Streams(1, "room", 0, 1)


def test_of_the_rows_those_stay_whose_number_is_at_most_one_over_rho():
    rows = np.arange(0, 5000, 3)
    luck = STREAMS.generator("icp_randomness/7").random(5000)
    left = IcpRandomness().thin(rows, 7, 4.0, 5000, STREAMS)
    np.testing.assert_array_equal(left, rows[luck[rows] <= 0.25])


def test_runs_have_luck_of_their_own():
    rows = np.arange(1000)
    one, other = (IcpRandomness().thin(rows, run, 2.0, 1000, STREAMS) for run in (0, 1))
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("rho", [2.0, 5.0])
def test_the_variance_grows_by_rho_less_p_over_one_less_p(rho):
    """Of the sum over a subsample, weighted by its probability: (1 - p) / p, at p / rho."""
    p, count, runs = 0.25, 2000, 3000
    values = np.random.default_rng(2).standard_normal(count)
    sums = {1.0: [], rho: []}
    for run in range(runs):
        rows = subsample(count, p, np.random.default_rng([5, run]))
        for level, found in sums.items():
            left = IcpRandomness().thin(rows, run, level, count, STREAMS)
            found.append(values[left].sum() * level / p)
    ratio = np.var(sums[rho]) / np.var(sums[1.0])
    assert ratio == pytest.approx((rho - p) / (1 - p), rel=0.1)
