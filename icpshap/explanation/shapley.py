"""Shapley values and interactions of a game, exactly.

A game of M players is an array (..., 2^M) of values, indexed by coalition as a bit mask: bit a is
set if player a is on. The players are the causes of an experiment, in their order.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from math import comb, factorial
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


Player = TypeVar("Player")
FULL_WEIGHT = 1e6  # in the place of infinity; with 1e12 the round-off is 5e-3


def coalitions(players: int) -> np.ndarray:
    """Which players are on: bool (2^M, M), the row number is the coalition's bit mask.

    >>> coalitions(2).tolist()
    [[False, False], [True, False], [False, True], [True, True]]
    """
    return (np.arange(2**players)[:, None] >> np.arange(players) & 1).astype(bool)


def coalition_values(instances: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """The mapping h_x (paper, Algorithm 1): instances (i, M) to their settings (i, 2^M, M).

    A player that is on takes the instance's value, one that is off its reference value (M,).
    """
    instances = np.asarray(instances, dtype=float)
    return np.where(coalitions(instances.shape[-1]), instances[..., None, :], reference)


def shapley_values(game: ArrayLike) -> np.ndarray:
    """Shapley values (..., M) of games (..., 2^M); they add up to f(all on) - f(none on).

    A player that changes nothing gets exactly 0, without round-off.

    >>> shapley_values(np.array([0.0, 1.0, 2.0, 5.0])).tolist()  # f of none, a, b, both
    [2.0, 3.0]
    """
    game = np.asarray(game, dtype=float)
    players = players_of(game)
    weight = _by_size(
        players - 1, lambda s: factorial(s) * factorial(players - s - 1) / factorial(players)
    )
    return np.stack([_gain(game, a) @ weight for a in range(players)], axis=-1)


def removal_effects(game: ArrayLike) -> np.ndarray:
    """What the value of games (..., 2^M) falls by without each player: (..., M).

    f(all on) - f(all on but this one); one that changes nothing there gets exactly 0.

    >>> removal_effects(np.array([0.0, 1.0, 2.0, 5.0])).tolist()
    [3.0, 4.0]
    """
    game = np.asarray(game, dtype=float)
    everyone = game.shape[-1] - 1
    without = [everyone ^ 1 << a for a in range(players_of(game))]
    return game[..., -1:] - game[..., without]


def interaction_indices(game: ArrayLike) -> np.ndarray:
    """Shapley interaction indices (..., M(M-1)/2) of games (..., 2^M), in the order of `couples`.

    Grabisch and Roubens (1999), Int. J. Game Theory 28: f(S+ab) - f(S+b) - f(S+a) + f(S) over the
    coalitions S without a and b, weighted by |S|! (M-|S|-2)! / (M-1)!.

    >>> interaction_indices(np.array([0.0, 1.0, 2.0, 5.0])).tolist()  # of (a, b)
    [2.0]
    """
    game = np.asarray(game, dtype=float)
    players = players_of(game)
    result = np.empty((*game.shape[:-1], comb(players, 2)))
    if players < 2:
        return result
    weight = _by_size(
        players - 2, lambda s: factorial(s) * factorial(players - s - 2) / factorial(players - 1)
    )
    gains = [_gain(game, b) for b in range(players)]
    for column, (a, b) in enumerate(couples(range(players))):
        result[..., column] = _gain(gains[b], a) @ weight
    return result


def couples(players: Iterable[Player]) -> list[tuple[Player, Player]]:
    """All couples (a, b) of players, a before b, in the order of `interaction_indices`.

    >>> couples(["a", "b", "c"])
    [('a', 'b'), ('a', 'c'), ('b', 'c')]
    """
    return list(combinations(players, 2))


def kernel_regression(game: ArrayLike) -> np.ndarray:
    """The closed form of Algorithm 1 of the paper, (..., 2^M) to (..., M): a cross-check.

    Weighted least squares of f minus f(none on) with the weights of Equation (3b); the infinite
    one of the full coalition becomes FULL_WEIGHT, the other meets a row of zeros.
    """
    game = np.asarray(game, dtype=float)
    on = coalitions(players_of(game)).astype(float)
    players = on.shape[1]
    weight = np.full(len(on), FULL_WEIGHT)
    for coalition, size in enumerate(on.sum(axis=1).astype(int)):
        if 0 < size < players:
            weight[coalition] = (players - 1) / (comb(players, size) * size * (players - size))
    solution = np.linalg.solve((on.T * weight) @ on, on.T * weight)
    return (game - game[..., :1]) @ solution.T


def _gain(game, player):
    """What a player adds to each coalition of the others: (..., 2^M) to (..., 2^(M - 1))."""
    halves = game.reshape(*game.shape[:-1], -1, 2, 2**player)
    gain = halves[..., 1, :] - halves[..., 0, :]
    return gain.reshape(*game.shape[:-1], -1)


def _by_size(players, weight):
    """A function of its size for each coalition (2^M,)."""
    by_size = np.array([weight(size) for size in range(players + 1)])
    return by_size[coalitions(players).sum(axis=1)]


def players_of(game: np.ndarray) -> int:
    """Number of players M of games (..., 2^M); raises ValueError for another length."""
    players = (game.shape[-1] - 1).bit_length()
    if game.shape[-1] != 2**players or players == 0:
        raise ValueError(
            f"A game has 2, 4, 8, ... values (one per coalition), not {game.shape[-1]}.\n"
            "Hint: the last axis of the array must be the coalitions' bit masks."
        )
    return players
