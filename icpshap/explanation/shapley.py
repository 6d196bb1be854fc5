"""Shapley values and interactions of a game, exactly.

A game of M players is an array (..., 2^M) of values, indexed by coalition as a bit mask: bit a is
set if player a is on. The players are the causes of an experiment, in their order.
"""

from itertools import combinations
from math import comb, factorial

import numpy as np


def coalitions(players):
    """Which players are on: bool (2^M, M), the row number is the coalition's bit mask."""
    return (np.arange(2**players)[:, None] >> np.arange(players) & 1).astype(bool)


def coalition_values(instances, reference):
    """The mapping h_x (paper, Algorithm 1): instances (i, M) to their settings (i, 2^M, M).

    A player that is on takes the instance's value, one that is off its reference value (M,).
    """
    instances = np.asarray(instances, dtype=float)
    return np.where(coalitions(instances.shape[-1]), instances[..., None, :], reference)


def shapley_values(game):
    """Shapley values (..., M) of games (..., 2^M); they add up to f(all on) - f(none on).

    A player that changes nothing gets exactly 0, without round-off.
    """
    game = np.asarray(game, dtype=float)
    on = coalitions(_players(game))
    players = on.shape[1]
    weight = np.array([factorial(s) * factorial(players - s - 1) for s in range(players)])
    result = np.empty((*game.shape[:-1], players))
    for a in range(players):
        without = np.flatnonzero(~on[:, a])
        gain = game[..., without | 1 << a] - game[..., without]
        result[..., a] = gain @ (weight[on[without].sum(axis=1)] / factorial(players))
    return result


def interaction_indices(game):
    """Shapley interaction indices (..., M(M-1)/2) of games (..., 2^M), in the order of `couples`.

    Grabisch and Roubens (1999), Int. J. Game Theory 28: f(S+ab) - f(S+b) - f(S+a) + f(S) over the
    coalitions S without a and b, weighted by |S|! (M-|S|-2)! / (M-1)!.
    """
    game = np.asarray(game, dtype=float)
    on = coalitions(_players(game))
    players = on.shape[1]
    weight = np.array([factorial(s) * factorial(players - s - 2) for s in range(players - 1)])
    result = np.empty((*game.shape[:-1], comb(players, 2)))
    for column, (a, b) in enumerate(couples(range(players))):
        without = np.flatnonzero(~on[:, a] & ~on[:, b])
        gain_with_b = game[..., without | 1 << a | 1 << b] - game[..., without | 1 << b]
        gain_alone = game[..., without | 1 << a] - game[..., without]
        share = weight[on[without].sum(axis=1)] / factorial(players - 1)
        result[..., column] = (gain_with_b - gain_alone) @ share
    return result


def couples(players):
    """All couples (a, b) of players, a before b, in the order of `interaction_indices`."""
    return list(combinations(players, 2))


def kernel_regression(game, full_weight=1e6):
    """The closed form of Algorithm 1 of the paper, (..., 2^M) to (..., M): a cross-check.

    Weighted least squares of f minus f(none on) with the weights of Equation (3b); the infinite
    one of the full coalition becomes `full_weight`, the other meets a row of zeros.
    """
    game = np.asarray(game, dtype=float)
    on = coalitions(_players(game)).astype(float)
    players = on.shape[1]
    weight = np.full(len(on), full_weight)
    for coalition, size in enumerate(on.sum(axis=1).astype(int)):
        if 0 < size < players:
            weight[coalition] = (players - 1) / (comb(players, size) * size * (players - size))
    solution = np.linalg.solve((on.T * weight) @ on, on.T * weight)
    return (game - game[..., :1]) @ solution.T


def _players(game):
    players = (game.shape[-1] - 1).bit_length()
    if game.shape[-1] != 2**players or players == 0:
        raise ValueError(
            f"A game has 2, 4, 8, ... values (one per coalition), not {game.shape[-1]}.\n"
            "Hint: the last axis of the array must be the coalitions' bit masks."
        )
    return players
