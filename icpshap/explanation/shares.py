"""W, the share of runs that do not end in their setting's own basin, failed ones among them.

Bounded, so that no run decides it: it stands beside every explanation. Its intervals have a width
even where nothing was seen.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.explanation import shapley
from icpshap.explanation.intervals import independent_runs, of_units, wilson
from icpshap.explanation.uncertainty import Estimate, estimate, over_replicates

if TYPE_CHECKING:
    from icpshap.explanation.method import Method
    from icpshap.explanation.sample import Sample


UNSEEN = 3.0  # runs: what never was seen in n runs has a share of at most 3/n, with 95 % confidence
ROUND_OFF = 1e-12


class Shares(NamedTuple):
    """W of i games of M causes, an `Estimate` each: of the clean setting and of that with all on
    (i, 1), its Shapley values and removal effects (i, M), its interactions (i, couples)."""

    clean: Estimate
    share: Estimate
    phi: Estimate
    removal: Estimate
    interactions: Estimate


def wrong_basin_shares(sample: Sample) -> np.ndarray:
    """Share of runs that are lost in each setting, with the ends of its interval: (S,) each.

    Wilson's interval, with several noise draws for as many independent runs as would vary as much
    as the draws do. NaN where there is no basin or no pose sample.
    """
    settings, number = sample.lost.shape
    if not (sample.returns.samples and number):
        return np.full((3, settings), np.nan)
    lost = sample.lost.astype(float)
    share = lost @ sample.weight / sample.weight.sum()
    varies = independent_runs(share, lost, sample.weight, sample.noise_draw)
    found = np.array([share, *wilson(share, *varies)])
    found[:, sample.no_basin] = np.nan
    if not sample.units:
        found[1:] = np.nan
    return found


def explain_shares(
    replicates: list[Sample], rows: list[np.ndarray], on: np.ndarray, method: Method
) -> Shares:
    """`Shares` of games, rows (i, 2^M) of each replicate; on (i, M): which causes are on.

    Of the parts: the joint jackknife over all runs, or the spread of the replicates; where neither
    varies, 3/n to either side for a cause that is on, n the runs of a setting in all replicates,
    and 6/n for the interaction of two, a difference of differences.
    """
    by_share = replace(
        method, divergence="wrong_basin_share", bias_correction="none", interval="jackknife"
    )
    players = on.shape[1]
    number = max(1, sum(sample.lost.shape[1] for sample in replicates))
    found = over_replicates(
        [
            estimate(sample, games, _parts, by_share)
            for sample, games in zip(replicates, rows, strict=True)
        ]
    )
    half = UNSEEN / number
    phi = _widened(found.part(slice(players)), on, half)
    removal = _widened(found.part(slice(players, 2 * players)), on, half)
    couples = np.array(shapley.couples(range(players)), dtype=int).reshape(-1, 2)
    both = on[:, couples].all(axis=-1)
    interactions = _widened(found.part(slice(2 * players, None)), both, 2 * half)
    clean, share = (_of_settings(replicates, [games[:, k] for games in rows]) for k in (0, -1))
    return Shares(clean, share, phi, removal, interactions)


def _of_settings(replicates, rows):
    """W of settings, rows (i,) of each replicate: an `Estimate` (i, 1), over all replicates."""
    found = np.array(
        [wrong_basin_shares(sample)[:, row] for sample, row in zip(replicates, rows, strict=True)]
    )
    value, low, high = found.mean(axis=0)
    if len(replicates) > 1:
        number = sum(sample.lost.shape[1] for sample in replicates)
        low, high = wilson(value, *of_units(value, found[:, 0].T, number))
    value, low, high = (column[:, None] for column in (value, low, high))
    return Estimate(value, low, high, np.full(value.shape, np.nan))


def _parts(game):
    read = (shapley.shapley_values, shapley.removal_effects, shapley.interaction_indices)
    return np.concatenate([of_game(game) for of_game in read], axis=-1)


def _widened(found, on, half):
    still = on & (found.high - found.low < ROUND_OFF)
    low = np.where(still, found.value - half, found.low)
    high = np.where(still, found.value + half, found.high)
    return Estimate(found.value, low, high, found.draw_variance_ratio)
