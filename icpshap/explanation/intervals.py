"""95 % intervals from the runs alone: what to leave out or draw again, and what follows from it.

The units of a sample are its runs; where several noise draws were made, runs that share one are
not independent of each other, and the units are whole noise draws. Samples of an estimator that
makes them depend on one another, and covariances, have no other units. A unit is left out of every
setting of a pair at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import ndtri, stdtrit

CONFIDENCE = 0.95


@dataclass(frozen=True)
class Resampling:
    """Weights (r, n) of n runs: first the sample itself, then its resamples by kind.

    The slices tell the rows where one unit is left out, where one run is left out (only if that is
    something else), and where units are drawn again with replacement.
    """

    weights: np.ndarray
    units: slice
    runs: slice
    bootstrap: slice

    @classmethod
    def of(
        cls,
        kept: np.ndarray,
        noise_draw: np.ndarray,
        jackknife: bool = True,
        bootstrap: int = 0,
        seed: int = 0,
        exchangeable: bool = True,
    ) -> Resampling:
        """Resampling of the runs that are kept, bool (n,); noise_draw (n,) is the draw of each.

        jackknife: whether to leave out units (and runs); bootstrap: number of bootstrap rows;
        exchangeable: whether runs of one noise draw are independent, and so units where there is
        but one. Where nothing is, every resample is the sample itself.
        """
        runs = np.eye(len(kept))[kept]
        draws = np.unique(noise_draw[kept])[:, None] == noise_draw
        several = len(draws) > 1
        everything = kept[None].astype(float)
        units = (draws & kept).astype(float) if several else runs if exchangeable else everything
        counts = np.random.default_rng(seed).multinomial(
            len(units), np.full(len(units), 1 / len(units)), bootstrap
        )
        parts = [
            everything,
            everything - units if jackknife and len(units) > 1 else units[:0],
            everything - runs if jackknife and several and exchangeable else runs[:0],
            counts @ units,
        ]
        ends = np.cumsum([len(part) for part in parts])
        return cls(np.concatenate(parts), *(slice(a, b) for a, b in pairwise(ends)))

    def jackknife(self, values: np.ndarray) -> np.ndarray:
        """Bias-corrected estimate m f - (m - 1) mean f_(-u) over m units: (r, ...) to (...)."""
        left_out = values[self.units]
        return len(left_out) * values[0] - (len(left_out) - 1) * left_out.mean(axis=0)

    def interval(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Low and high end (...) from values (r, ...): by bootstrap if it was drawn, or jackknife.

        Both are intervals for the true value, free of the bias that values[0] may have: the
        jackknife's middle is the corrected estimate, and the basic (reverse percentile) bootstrap
        mirrors its resamples at values[0]. NaN where there are no units.
        """
        upper = (1 + CONFIDENCE) / 2
        if self.bootstrap.start < self.bootstrap.stop:
            quantiles = np.quantile(values[self.bootstrap], [upper, 1 - upper], axis=0)
            low, high = 2 * values[0] - quantiles
            return low, high
        left_out = values[self.units]
        if len(left_out) == 0:
            nothing = np.full(values.shape[1:], np.nan)
            return nothing, nothing
        half = np.sqrt(jackknife_variance(left_out)) * stdtrit(len(left_out) - 1, upper)
        middle = self.jackknife(values)
        return middle - half, middle + half

    def draw_variance_ratio(self, values: np.ndarray) -> np.ndarray:
        """Jackknife variance over whole noise draws, divided by that over runs, (...).

        About 1 where the noise draws add nothing to what the runs vary; NaN for one noise draw.
        """
        if self.runs.start == self.runs.stop:
            return np.full(values.shape[1:], np.nan)
        within = jackknife_variance(values[self.runs])
        between = jackknife_variance(values[self.units])
        return np.divide(between, within, out=np.full_like(within, np.nan), where=within > 0)


def jackknife_variance(left_out: np.ndarray) -> np.ndarray:
    """Variance of an estimate from its leave-one-out values (m, ...), to (...)."""
    m = len(left_out)
    return (m - 1) / m * np.square(left_out - left_out.mean(axis=0)).sum(axis=0)


def wilson(
    share: np.ndarray | float, number: np.ndarray | int, quantile: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Wilson's interval (low, high) of a share of `number` trials."""
    square = quantile**2
    middle = (share + square / (2 * number)) / (1 + square / number)
    half = quantile / (1 + square / number)
    half = half * np.sqrt(share * (1 - share) / number + square / (4 * number**2))
    # Without round-off at the ends, where the interval begins or ends with the share itself.
    low = np.where(share <= 0, 0.0, np.maximum(middle - half, 0.0))
    return low, np.where(share >= 1, 1.0, np.minimum(middle + half, 1.0))


def of_units(
    share: np.ndarray | float, by_unit: np.ndarray, number: np.ndarray | int
) -> tuple[np.ndarray, np.ndarray]:
    """How many independent runs would vary as much as units do, and the quantile of Student's t.

    share (...) of `number` runs; by_unit (..., u): that of each unit, NaN for one without runs.
    """
    units = np.isfinite(by_unit).sum(axis=-1)
    # As the mean of what is there; of a share without any unit nothing is known, nor warned of.
    middle = np.nansum(by_unit, axis=-1, keepdims=True) / np.maximum(units, 1)[..., None]
    with np.errstate(invalid="ignore"):  # one unit alone does not tell how units vary
        variance = np.nansum(np.square(by_unit - middle), axis=-1) / (units - 1) / units
    binomial = share * (1 - share)
    size = np.divide(binomial, variance, out=np.full_like(share, np.inf), where=variance > 0)
    return np.minimum(size, number), stdtrit(units - 1, (1 + CONFIDENCE) / 2)


def independent_runs(
    share: np.ndarray | float, marked: np.ndarray, weight: np.ndarray, noise_draw: np.ndarray
) -> tuple[np.ndarray | int, np.ndarray | float]:
    """The same (...) of a share of runs that are marked (..., n), over noise draws (n,).

    weight (..., n): what a run counts, with mean 1 over those that do. With one draw all runs are
    independent, and the quantile is that of the normal distribution.
    """
    weight = np.broadcast_to(weight, marked.shape).astype(float)
    number = weight.sum(axis=-1)
    draws = np.unique(noise_draw)
    if len(draws) == 1:
        return number, ndtri((1 + CONFIDENCE) / 2)
    of_draw = (noise_draw[:, None] == draws).astype(float)
    counted = weight @ of_draw
    by_draw = np.full_like(counted, np.nan)
    np.divide((marked * weight) @ of_draw, counted, out=by_draw, where=counted > 0)
    return of_units(share, by_draw, number)


def mean_interval(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean of independent values (m, ...) with the ends of its interval, each (...)."""
    m = len(values)
    half = values.std(axis=0, ddof=1) / np.sqrt(m) * stdtrit(m - 1, (1 + CONFIDENCE) / 2)
    middle = values.mean(axis=0)
    return middle, middle - half, middle + half
