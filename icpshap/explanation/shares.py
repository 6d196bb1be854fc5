"""W, the share of runs that do not end in their setting's own basin, failed ones among them.

Bounded, so that no run decides it: it stands beside every explanation. Its intervals have a width
even where nothing was seen.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from icpshap.explanation import shapley
from icpshap.explanation.intervals import CONFIDENCE
from icpshap.explanation.uncertainty import Estimate, estimate

UNSEEN = 3.0  # runs: what never was seen in n runs has a share of at most 3/n, with 95 % confidence
ROUND_OFF = 1e-12


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
    size, quantile = np.full(settings, float(number)), norm.ppf((1 + CONFIDENCE) / 2)
    draws = np.unique(sample.noise_draw)
    if len(draws) > 1:
        of_draw = (sample.noise_draw[:, None] == draws) * sample.weight[:, None]
        by_draw = lost @ (of_draw / of_draw.sum(axis=0))
        variance = by_draw.var(axis=1, ddof=1) / len(draws)
        binomial = share * (1 - share)
        alike = np.divide(binomial, variance, out=np.full(settings, np.inf), where=variance > 0)
        size = np.minimum(alike, number)
        quantile = student.ppf((1 + CONFIDENCE) / 2, len(draws) - 1)
    found = np.array([share, *wilson(share, size, quantile)])
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


def explain_shares(sample, games, on, method):
    """Shapley values of W and its removal effects: two `Estimate`s (i, M) of games, rows (i, 2^M).

    on (i, M): which causes differ from their reference value. Joint jackknife over all runs; where
    no mark varies, 3/n to either side for a cause that is on.
    """
    by_share = replace(
        method, divergence="wrong_basin_share", bias_correction="none", interval="jackknife"
    )
    players = on.shape[1]
    found = estimate(sample, games, _phi_and_removal, by_share)
    parts = found.part(slice(players)), found.part(slice(players, None))
    return [_widened(part, on, UNSEEN / max(1, sample.lost.shape[1])) for part in parts]


def _phi_and_removal(game):
    return np.concatenate([shapley.shapley_values(game), shapley.removal_effects(game)], axis=-1)


def _widened(found, on, half):
    still = on & (found.high - found.low < ROUND_OFF)
    low = np.where(still, found.value - half, found.low)
    high = np.where(still, found.value + half, found.high)
    return Estimate(found.value, low, high, found.draw_variance_ratio)
