"""Shapley values: axioms, the paper's regression, and independent implementations."""

import numpy as np
import pytest
import shap
from shapiq import ExactComputer

from icpshap.explanation import shapley


@pytest.fixture(params=[2, 3, 4])
def game(request):
    """A random game of M players; f(none on) is not 0."""
    return np.random.default_rng(request.param).normal(size=2**request.param) * 10


def players_of(game):
    return len(game).bit_length() - 1


def exact_computer(game):
    def value(coalitions):
        masks = coalitions.astype(int) @ (1 << np.arange(coalitions.shape[1]))
        return game[masks]

    return ExactComputer(value, n_players=players_of(game))


def test_efficiency(game):
    assert shapley.shapley_values(game).sum() == pytest.approx(game[-1] - game[0])


def test_a_player_that_changes_nothing_gets_exactly_nothing():
    without = np.random.default_rng(0).normal(size=4)
    game = np.concatenate([without, without])  # the third player's bit does not matter
    assert shapley.shapley_values(game)[2] == 0
    interaction = dict(
        zip(shapley.couples(range(3)), shapley.interaction_indices(game), strict=True)
    )
    assert interaction[0, 2] == interaction[1, 2] == 0
    assert interaction[0, 1] != 0


def test_symmetry():
    size = shapley.coalitions(3).sum(axis=1)
    values = shapley.shapley_values(np.array([1.0, 3.0, 4.0, 9.0])[size])
    np.testing.assert_allclose(values, 8 / 3)


def test_linearity(game):
    other = np.random.default_rng(9).normal(size=game.shape)
    np.testing.assert_allclose(
        shapley.shapley_values(2 * game - other),
        2 * shapley.shapley_values(game) - shapley.shapley_values(other),
    )


def test_glove_game():
    """One left glove (player 0), two right ones: a pair is worth 1."""
    on = shapley.coalitions(3)
    values = shapley.shapley_values((on[:, 0] & (on[:, 1] | on[:, 2])).astype(float))
    np.testing.assert_allclose(values, [4 / 6, 1 / 6, 1 / 6])


def test_one_player_gets_everything():
    assert shapley.shapley_values([2.0, 5.0]).tolist() == [3.0]


def test_leading_dimensions():
    games = np.random.default_rng(0).normal(size=(4, 5, 8))
    assert shapley.shapley_values(games).shape == (4, 5, 3)
    np.testing.assert_allclose(
        shapley.interaction_indices(games)[2, 3], shapley.interaction_indices(games[2, 3])
    )


def test_kernel_regression_is_exact_to_1e_5(game):
    exact = shapley.shapley_values(game)
    error = np.abs(shapley.kernel_regression(game) - exact).max()
    assert error < 1e-5 * np.abs(exact).max()


def test_kernel_regression_subtracts_the_empty_coalition(game):
    np.testing.assert_allclose(
        shapley.kernel_regression(game + 100), shapley.kernel_regression(game), atol=1e-9
    )


def test_values_agree_with_kernel_explainer(game):
    """On the function that the game is of the sources' values, with the clean instance behind."""
    players = players_of(game)

    def f(x):
        return game[(x > 0).astype(int) @ (1 << np.arange(players))]

    explainer = shap.KernelExplainer(f, np.zeros((1, players)))
    values = explainer.shap_values(np.ones((1, players)), l1_reg=False, silent=True)[0]
    np.testing.assert_allclose(shapley.shapley_values(game), values, atol=1e-8)


def test_values_and_interactions_agree_with_shapiq(game):
    players = players_of(game)
    values = exact_computer(game)(index="SV", order=1)
    indices = exact_computer(game)(index="SII", order=2)
    np.testing.assert_allclose(
        shapley.shapley_values(game), [values[(a,)] for a in range(players)], atol=1e-10
    )
    np.testing.assert_allclose(
        shapley.interaction_indices(game),
        [indices[pair] for pair in shapley.couples(range(players))],
        atol=1e-10,
    )


def test_coalition_values_are_the_instances_or_the_reference_values():
    settings = shapley.coalition_values([[0.09, 1.1, 0.07]], [0.0, 1.0, 0.0])[0]
    assert settings[0].tolist() == [0.0, 1.0, 0.0]
    assert settings[0b011].tolist() == [0.09, 1.1, 0.0]
    assert settings[0b111].tolist() == [0.09, 1.1, 0.07]


@pytest.mark.parametrize("length", [1, 3, 7])
def test_a_game_must_have_a_value_for_each_coalition(length):
    with pytest.raises(ValueError, match=rf"2, 4, 8, .* not {length}\.\nHint: the last axis"):
        shapley.shapley_values(np.zeros(length))
