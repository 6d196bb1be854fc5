"""Other ways to share a game out, beside Shapley values: what their axioms buy.

Games are as in `shapley`: arrays (..., 2^M) of values by coalition. Neither of these adds up to
what there is to share.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from icpshap.explanation.shapley import coalitions, players_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


WIDTH = 0.75  # of LIME's kernel, in units of sqrt(M): the default of its authors' code


def banzhaf_values(game: ArrayLike) -> np.ndarray:
    """Banzhaf values (..., M): the mean of what a player adds to the coalitions of the others."""
    game = np.asarray(game, dtype=float)
    on = coalitions(players_of(game))
    return np.stack([game[..., a].mean(-1) - game[..., ~a].mean(-1) for a in on.T], axis=-1)


def lime_weights(game: ArrayLike) -> np.ndarray:
    """Coefficients (..., M) of LIME's weighted regression on all coalitions, with free intercept.

    Ribeiro, Singh and Guestrin (2016), KDD: a coalition z weighs sqrt(exp(-(M - |z|)/w^2)), the
    kernel of the authors' code for the distance sqrt(M - |z|) to the coalition of all, with w = .75
    sqrt(M); without its ridge penalty, since no coalition is missing.
    """
    game = np.asarray(game, dtype=float)
    on = coalitions(players_of(game)).astype(float)
    players = on.shape[1]
    missing = players - on.sum(axis=1)
    weight = np.sqrt(np.exp(-missing / (WIDTH**2 * players)))
    design = np.column_stack([np.ones(len(on)), on])
    solution = np.linalg.solve((design.T * weight) @ design, design.T * weight)
    return game @ solution[1:].T
