"""95 % intervals from the runs alone: which runs to leave out or draw again, and what follows.

Deleting run r deletes it from every setting of a pair at once. Where several noise draws were
made, runs that share one are not independent: then whole noise draws are deleted.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import t as student

CONFIDENCE = 0.95
BOOTSTRAP_DRAWS = 1000


@dataclass(frozen=True)
class Resampling:
    """Weights (r, n) of n runs: the sample itself, then its resamples by kind.

    `runs`, `draws` and `bootstrap` are the rows where one run is left out, where one noise draw is
    left out (none if there is but one), and where as many runs or noise draws are drawn again.
    """

    weights: np.ndarray
    runs: slice
    draws: slice
    bootstrap: slice

    @classmethod
    def of(cls, kept, noise_draw, leave_out=True, bootstrap=0, seed=0):
        """Resampling of the runs kept (n,), with noise draw numbers (n,).

        leave_out: whether to make the leave-one-out rows; bootstrap: number of bootstrap rows.
        """
        kept = np.asarray(kept, dtype=bool)
        units = np.eye(len(kept))[kept]
        members = noise_draw[kept][None, :] == np.unique(noise_draw[kept])[:, None]
        draws = members.astype(float) @ units
        several = len(draws) > 1
        rows = [kept[None].astype(float)]
        rows.append(kept - units if leave_out else units[:0])
        rows.append(kept - draws if leave_out and several else units[:0])
        blocks = draws if several else units
        generator = np.random.default_rng(seed)
        counts = generator.multinomial(len(blocks), np.ones(len(blocks)) / len(blocks), bootstrap)
        rows.append(counts @ blocks)
        ends = np.cumsum([len(block) for block in rows])
        return cls(np.concatenate(rows), *(slice(a, b) for a, b in pairwise(ends)))

    def jackknife(self, values):
        """Bias-corrected value n f - (n - 1) mean f_(-r), from values (r, ...) to (...)."""
        return _pseudo_mean(values[0], values[self.runs])

    def interval(self, values):
        """Low and high end (...) from values (r, ...): bootstrap rows if any, else jackknife.

        Both are about the true value, not about values[0], whose bias they take away: the
        jackknife's interval has the corrected value in its middle, the basic (reverse percentile)
        bootstrap mirrors its resamples at values[0].
        """
        tails = np.array([1 + CONFIDENCE, 1 - CONFIDENCE]) / 2
        if self.bootstrap.start < self.bootstrap.stop:
            low, high = 2 * values[0] - np.quantile(values[self.bootstrap], tails, axis=0)
            return low, high
        resamples = values[self.draws] if self.several_draws else values[self.runs]
        half = np.sqrt(jackknife_variance(resamples)) * student.ppf(tails[0], len(resamples) - 1)
        middle = self.jackknife(values)
        return middle - half, middle + half

    @property
    def several_draws(self):
        return self.draws.start < self.draws.stop

    def draw_variance_ratio(self, values):
        """Jackknife variance over whole noise draws, divided by the one over runs, (...).

        About 1 where the noise draws add nothing to what the runs vary; NaN for one noise draw.
        """
        if not self.several_draws:
            return np.full(values.shape[1:], np.nan)
        within = jackknife_variance(values[self.runs])
        between = jackknife_variance(values[self.draws])
        return np.divide(between, within, out=np.full_like(within, np.nan), where=within > 0)


def jackknife_variance(resamples):
    """Variance of an estimate from its leave-one-out values (m, ...), to (...)."""
    m = len(resamples)
    return (m - 1) / m * np.square(resamples - resamples.mean(axis=0)).sum(axis=0)


def mean_interval(values):
    """Mean of independent values (m, ...) with its 95 % interval, each (...)."""
    m = len(values)
    half = values.std(axis=0, ddof=1) / np.sqrt(m) * student.ppf((1 + CONFIDENCE) / 2, m - 1)
    middle = values.mean(axis=0)
    return middle, middle - half, middle + half


def _pseudo_mean(value, resamples):
    m = len(resamples)
    return m * value - (m - 1) * resamples.mean(axis=0)
