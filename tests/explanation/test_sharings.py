"""LIME's regression and Banzhaf values, against other ways to compute them."""

from itertools import combinations

import numpy as np
import pytest

from icpshap.explanation import shapley, sharings


@pytest.fixture(params=[1, 2, 3, 7])
def game(request):
    return np.random.default_rng(request.param).normal(size=2**request.param) * 10


def test_banzhaf_values_by_hand():
    # f(none), f(a), f(b), f(ab)
    np.testing.assert_allclose(sharings.banzhaf_values([1.0, 4.0, 3.0, 10.0]), [5.0, 4.0])


def test_banzhaf_values_are_the_mean_gain(game):
    players = range(shapley.players_of(game))
    for a in players:
        gains = []
        others = [b for b in players if b != a]
        for size in range(len(others) + 1):
            for group in combinations(others, size):
                mask = sum(1 << b for b in group)
                gains.append(game[mask | 1 << a] - game[mask])
        assert sharings.banzhaf_values(game)[a] == pytest.approx(np.mean(gains))


def test_lime_of_one_cause_is_the_difference():
    assert sharings.lime_weights([1.0, 4.0])[0] == pytest.approx(3.0)


def test_lime_is_weighted_least_squares(game):
    """Independently: rows scaled by the root of their weight, by numpy's least squares."""
    players = shapley.players_of(game)
    rows, values = [], []
    for mask in range(2**players):
        on = [mask >> a & 1 for a in range(players)]
        distance = np.sqrt(players - sum(on))
        weight = np.sqrt(np.exp(-(distance**2) / (0.75 * np.sqrt(players)) ** 2))
        rows.append(np.sqrt(weight) * np.array([1.0, *on]))
        values.append(np.sqrt(weight) * game[mask])
    expected = np.linalg.lstsq(np.array(rows), np.array(values))[0][1:]
    np.testing.assert_allclose(sharings.lime_weights(game), expected, rtol=1e-9)


def test_all_agree_where_causes_add_up():
    on = shapley.coalitions(4)
    game = 2.0 + on @ [1.0, -3.0, 0.5, 4.0]
    for share in (shapley.shapley_values, sharings.banzhaf_values, sharings.lime_weights):
        np.testing.assert_allclose(share(game), [1.0, -3.0, 0.5, 4.0], atol=1e-9)


def test_only_shapley_values_add_up(game):
    rest = game[-1] - game[0]
    assert shapley.shapley_values(game).sum() == pytest.approx(rest)
    if len(game) > 4:
        for share in (sharings.banzhaf_values, sharings.lime_weights):
            assert abs(share(game).sum() - rest) > 0.1
