"""W, the share of runs that do not end in their setting's own basin, failed ones among them.

Bounded, so that no run decides it: it stands beside every explanation. Its intervals have a width
even where nothing was seen.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from icpshap.explanation import shapley
from icpshap.explanation.intervals import CONFIDENCE
from icpshap.explanation.uncertainty import Estimate, estimate, over_replicates

UNSEEN = 3.0  # runs: what never was seen in n runs has a share of at most 3/n, with 95 % confidence
ROUND_OFF = 1e-12


class Shares(NamedTuple):
    """W of i games of M causes, an `Estimate` each: of the clean setting and of that with all on
    (i, 1), its Shapley values and removal effects (i, M)."""

    clean: Estimate
    share: Estimate
    phi: Estimate
    removal: Estimate


def wrong_basin_shares(sample):
    """Share of runs that are lost in each setting, with the ends of its interval: (S,) each.

    Wilson's interval; with several noise draws for the number of independent runs that would vary
    as much as the draws do, with Student's t. NaN where there is no basin or no pose sample.
    """
    settings, number = sample.lost.shape
    if not (sample.returns.samples and number):
        return np.full((3, settings), np.nan)
    lost = sample.lost.astype(float)
    share = lost @ sample.weight / sample.weight.sum()
    draws = np.unique(sample.noise_draw)
    if len(draws) > 1:
        of_draw = (sample.noise_draw[:, None] == draws) * sample.weight[:, None]
        by_draw = lost @ (of_draw / of_draw.sum(axis=0))
        found = np.array([share, *_over_units(share, by_draw, number)])
    else:
        found = np.array([share, *wilson(share, number, norm.ppf((1 + CONFIDENCE) / 2))])
    found[:, sample.no_basin] = np.nan
    if not sample.units:
        found[1:] = np.nan
    return found


def wilson(share, number, quantile):
    """Wilson's interval (low, high) of a share of `number` trials."""
    square = quantile**2
    middle = (share + square / (2 * number)) / (1 + square / number)
    half = quantile / (1 + square / number)
    half = half * np.sqrt(share * (1 - share) / number + square / (4 * number**2))
    # Without round-off at the ends, where the interval begins or ends with the share itself.
    low = np.where(share <= 0, 0.0, np.maximum(middle - half, 0.0))
    return low, np.where(share >= 1, 1.0, np.minimum(middle + half, 1.0))


def _over_units(share, of_units, number):
    """Interval of a share (...) of `number` runs that are independent in whole units (..., u) only.

    Wilson's, for as many independent runs as would vary as much as the units do.
    """
    units = of_units.shape[-1]
    variance = of_units.var(axis=-1, ddof=1) / units
    binomial = share * (1 - share)
    size = np.divide(binomial, variance, out=np.full_like(share, np.inf), where=variance > 0)
    return wilson(share, np.minimum(size, number), student.ppf((1 + CONFIDENCE) / 2, units - 1))


def explain_shares(replicates, rows, on, method):
    """`Shares` of games, rows (i, 2^M) of each replicate; on (i, M): which causes are on.

    Of the parts: the joint jackknife over all runs, or the spread of the replicates; where neither
    varies, 3/n to either side for a cause that is on, n the runs of a setting in all replicates.
    """
    by_share = replace(
        method, divergence="wrong_basin_share", bias_correction="none", interval="jackknife"
    )
    players = on.shape[1]
    number = max(1, sum(sample.lost.shape[1] for sample in replicates))
    found = over_replicates(
        [
            estimate(sample, games, _phi_and_removal, by_share)
            for sample, games in zip(replicates, rows, strict=True)
        ]
    )
    parts = found.part(slice(players)), found.part(slice(players, None))
    phi, removal = (_widened(part, on, UNSEEN / number) for part in parts)
    clean, share = (_of_settings(replicates, [games[:, k] for games in rows]) for k in (0, -1))
    return Shares(clean, share, phi, removal)


def _of_settings(replicates, rows):
    """W of settings, rows (i,) of each replicate: an `Estimate` (i, 1), over all replicates."""
    found = np.array(
        [wrong_basin_shares(sample)[:, row] for sample, row in zip(replicates, rows, strict=True)]
    )
    value, low, high = found.mean(axis=0)
    if len(replicates) > 1:
        number = sum(sample.lost.shape[1] for sample in replicates)
        low, high = _over_units(value, found[:, 0].T, number)
    ends = (column[:, None] for column in (value, low, high))
    return Estimate(*ends, np.full((len(value), 1), np.nan))


def _phi_and_removal(game):
    return np.concatenate([shapley.shapley_values(game), shapley.removal_effects(game)], axis=-1)


def _widened(found, on, half):
    still = on & (found.high - found.low < ROUND_OFF)
    low = np.where(still, found.value - half, found.low)
    high = np.where(still, found.value + half, found.high)
    return Estimate(found.value, low, high, found.draw_variance_ratio)
