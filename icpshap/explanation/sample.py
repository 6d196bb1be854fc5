"""What an estimator returned for the settings of a pair: pose errors, covariances, or both.

The spread of a setting is the covariance of its samples plus the mean covariance of its noise draws
plus the floor; whatever the estimator does not return is not there.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from icpshap.errors import UserError
from icpshap.estimators.kind import GOOD_STATUS, Returns
from icpshap.explanation import readings
from icpshap.explanation.basins import find_basins
from icpshap.explanation.chains import effective_sample_size
from icpshap.tables import INITIAL_XI, XI, covariances

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from icpshap.explanation.method import Method


FEWEST_RUNS = 50  # independent ones, from which a covariance is computed
FEWEST_SAMPLES = readings.DIMENSION + 1  # others, from which it can have full rank


@dataclass(frozen=True)
class Sample:
    """The runs of one pair and one seed: S settings with the same n runs in each.

    A run is a pose sample or, of an estimator that returns covariances alone, its estimate in one
    noise draw. causes (M) names; settings (S, M) their values; again (S,) marks the clean setting
    with random draws of its own; xi and initial_xi (S, n, 6) errors of final and initial pose,
    rotation [rad] first; failed, wrong_basin (S, n); no_covariance (S, n): the covariance that
    belongs to the samples of their noise draw failed, or is that of another basin; no_basin (S,):
    the runs of the setting have no basin of their own; noise_draw (n,) which one a run used; weight
    (n,) of the samples; covariance (S, K, 6, 6) [rad, m] of each noise draw, or None; length [m]:
    the pair's characteristic length; far (S,): of the registrations that covariances are made of,
    how many ended in another basin, in the draw with most; last_f: what `uncertainty.evaluate`
    found last.
    """

    causes: tuple
    settings: np.ndarray
    again: np.ndarray
    xi: np.ndarray
    initial_xi: np.ndarray
    failed: np.ndarray
    no_covariance: np.ndarray
    wrong_basin: np.ndarray
    no_basin: np.ndarray
    noise_draw: np.ndarray
    weight: np.ndarray
    covariance: np.ndarray | None
    returns: Returns
    length: float
    far: np.ndarray | int = 0
    last_f: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    @classmethod
    def without_runs(cls, causes: Iterable[str], settings: np.ndarray, returns: Returns) -> Sample:
        """The sample of a pair that was not registered; settings (S, M): values of the causes."""
        marks = np.zeros((len(settings), 0), dtype=bool)
        xi = np.zeros((*marks.shape, 6))
        again = np.zeros(len(settings), dtype=bool)
        return cls(
            causes=tuple(causes),
            settings=settings,
            again=again,
            xi=xi,
            initial_xi=xi,
            failed=marks,
            no_covariance=marks,
            wrong_basin=marks,
            no_basin=again,
            noise_draw=np.zeros(0),
            weight=np.zeros(0),
            covariance=None,
            returns=returns,
            length=np.nan,
        )

    @property
    def fewest(self) -> int:
        """The number of runs below which nothing is computed."""
        if self.returns.exchangeable:
            return FEWEST_RUNS
        return FEWEST_SAMPLES if self.returns.samples else 1

    @cached_property
    def effective(self) -> np.ndarray:
        """How many independent samples those of each setting are worth (S,): all of Monte Carlo's.

        Of the states of a chain the effective sample size, summed over noise draws; NaN for samples
        of which that is not known, and for covariances.
        """
        number = (~self.failed).sum(axis=1).astype(float)
        if self.returns.exchangeable:
            return number
        if not self.returns.chain or not self.xi.size:
            return np.full(len(self.settings), np.nan)
        draws = [self.noise_draw == draw for draw in np.unique(self.noise_draw)]
        found = [
            sum(effective_sample_size(xi[of & good]) for of in draws if (of & good).sum() > 3)
            for xi, good in zip(self.xi, ~self.failed, strict=True)
        ]
        return np.minimum(found, number)

    @property
    def units(self) -> str:
        """What is left out for intervals: runs, noise draws, or nothing ("")."""
        return self.returns.units(len(np.unique(self.noise_draw)))

    def rows(self, values: ArrayLike, again: bool = False) -> np.ndarray:
        """Row of each setting in values (..., M). Raises UserError if one was not run."""
        values = np.asarray(values, dtype=float)
        flat = values.reshape(-1, values.shape[-1])
        known = pd.MultiIndex.from_arrays([*self.settings.T, self.again])
        wanted = pd.MultiIndex.from_arrays([*flat.T, np.full(len(flat), again)])
        rows = known.get_indexer(wanted)
        if (rows < 0).any():
            missing = np.unique(flat[rows < 0], axis=0)
            first = ", ".join(f"{c} {v:g}" for c, v in zip(self.causes, missing[0], strict=True))
            raise UserError(
                f"{len(missing)} settings have no runs, the first is {first}; "
                f"{len(self.settings)} settings have.\n"
                "Hint: the runs belong to another configuration; run the registrations again."
            )
        return rows.reshape(values.shape[:-1])

    @property
    def lost(self) -> np.ndarray:
        """Runs (S, n) that did not end in their setting's own basin: failed, or in a wrong one."""
        return self.failed | self.wrong_basin

    @cached_property
    def _of_runs(self):
        """Numbers (S, n) of the runs, which readings average."""
        xi = np.where(self.failed[..., None], np.nan, self.xi)
        return {**readings.run_numbers(xi, self.length), "lost": self._share_lost()}

    def _share_lost(self):
        return np.where(self.no_basin[:, None], np.nan, self.lost.astype(float))

    def spread(
        self, rows: np.ndarray | int | np.integer, weights: np.ndarray, method: Method
    ) -> readings.Spread:
        """`readings.Spread` of settings `rows` (...) under each weighting (r, n) of the runs."""
        return readings.Spread(
            self.xi[rows],
            weights * self.weight,
            method.floor,
            added=self._mean_covariance(rows, weights),
            scatters=self.returns.samples,
            of_runs={name: values[rows] for name, values in self._of_runs.items()},
        )

    def variance_along(
        self, rows: np.ndarray, vectors: np.ndarray, weights: np.ndarray
    ) -> np.ndarray:
        """Variance (..., r) of settings `rows` (...) along vectors (..., d, 6), summed over d.

        Under each weighting (r, n) of the runs, without a floor [rad^2 or m^2].
        """
        result = np.zeros((*rows.shape, len(weights)))
        if self.returns.samples:
            used = weights.any(axis=0)
            weighted = (weights * self.weight)[:, used]
            along = self.xi[rows][..., used, :] @ np.swapaxes(vectors, -1, -2)
            along = along - np.median(along, axis=-2, keepdims=True)
            square = np.square(along).sum(axis=-1, keepdims=True)
            n = weighted.sum(axis=1)
            sums = readings.weighted_sums(weighted, np.concatenate([along, square], axis=-1))
            scatter = sums[..., -1] - np.square(sums[..., :-1]).sum(axis=-1) / n
            result += scatter / (n - 1)
        if self.covariance is not None:
            of_draws = np.nan_to_num(self.covariance[rows])
            along = np.einsum("...di,...kij,...dj->...k", vectors, of_draws, vectors)
            result += along @ self._share_of_draws(weights).T
        return result

    def numbers(self, name: str) -> np.ndarray:
        """A number (S, n) of the runs, of those that `readings.run_numbers` gives."""
        return self._of_runs[name]

    def mean(self, name: str, rows: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Weighted mean (..., r) of a number of the runs of settings `rows` (...)."""
        return readings.weighted_mean(weights * self.weight, self._of_runs[name][rows])

    def _mean_covariance(self, rows, weights):
        """Mean (..., r, 6, 6) over the noise draws."""
        if self.covariance is None:
            return 0.0
        # A draw that failed is left out with all of its runs.
        of_draws = np.nan_to_num(self.covariance[rows])
        return np.einsum("rk,...kab->...rab", self._share_of_draws(weights), of_draws)

    def _share_of_draws(self, weights):
        """What each noise draw counts (r, K) under each weighting: as much as its runs."""
        share = weights @ (self.noise_draw[:, None] == np.unique(self.noise_draw))
        return share / share.sum(axis=1, keepdims=True)


def samples(
    runs: pd.DataFrame | None,
    estimates: pd.DataFrame | None,
    causes: Iterable[str],
    returns: Returns,
    method: Method,
    length: float,
) -> list[Sample]:
    """One `Sample` per replicate of a pair's tables of runs and estimates (None if not returned).

    causes: names of those of the experiment; length [m]: the pair's characteristic length. Raises
    UserError if the settings differ in their runs.
    """
    keys = ["replicate", "again", *causes]
    if estimates is not None:
        estimates = estimates.sort_values([*keys, "noise_draw"])
        _check_complete(estimates, keys, "noise_draw")
    if runs is None:
        assert estimates is not None  # an estimator returns one or the other, or both
        runs = estimates.assign(run=estimates["noise_draw"], weight=1.0)
        runs[INITIAL_XI] = np.nan
    else:
        runs = runs.sort_values([*keys, "run"])
        _check_complete(runs, keys, "run")
    of_replicate = dict(list(estimates.groupby("replicate"))) if estimates is not None else {}
    return [
        _sample(part, of_replicate.get(replicate), tuple(causes), returns, method, length)
        for replicate, part in runs.groupby("replicate")
    ]


def _check_complete(table, keys, number):
    """Raise UserError unless every setting has the numbers 0 to n - 1 once each."""
    counts = table.groupby(keys)[number].agg(["count", "nunique", "max"])
    n = counts["count"].max()
    if not (counts.eq([n, n, n - 1]).all(axis=None)):
        wrong = counts[counts.ne([n, n, n - 1]).any(axis=1)]
        what = "runs" if number == "run" else "noise draws"
        raise UserError(
            f"{len(wrong)} of {len(counts)} settings do not have the {what} 0 to {n - 1} once "
            f"each, the first is {dict(zip(keys, wrong.index[0], strict=True))}.\n"
            "Hint: a file of runs is missing or there twice; run the registrations again."
        )


def _sample(runs, estimates, causes, returns, method, length):
    n = runs["run"].max() + 1
    first = runs.iloc[::n]
    noise_draw = runs["noise_draw"].to_numpy()[:n]
    xi = runs[XI].to_numpy(dtype=float).reshape(-1, n, 6)
    failed = _failed(runs).reshape(-1, n)
    covariance, far = None, np.zeros(len(first), dtype=int)
    if estimates is not None:
        covariance = covariances(estimates).reshape(len(first), -1, 6, 6)
        far = estimates["n_far"].to_numpy().reshape(len(first), -1).max(axis=1)
    weight = runs["weight"].to_numpy(dtype=float).reshape(-1, n)
    if not (weight == weight[0]).all():
        raise UserError(
            "The weights of the samples differ between settings, and a sample is left out of all.\n"
            "Hint: an estimator gives sample k the same weight in every setting."
        )
    no_covariance, wrong_basin = np.zeros((2, *failed.shape), dtype=bool)
    no_basin = np.zeros(len(first), dtype=bool)
    if returns.samples:
        wrong_basin, no_basin = _basins(xi, failed, method, length)
    if returns.samples and estimates is not None:
        # A covariance at a pose in another basin than that of the runs says nothing of these.
        poses = estimates[XI].to_numpy(dtype=float).reshape(len(first), -1, 6)
        useless = _failed(estimates).reshape(len(first), -1)
        useless = useless | _apart(poses, xi, failed, method, length)
        no_covariance = useless[:, np.searchsorted(np.unique(noise_draw), noise_draw)]
    return Sample(
        causes=causes,
        settings=first[list(causes)].to_numpy(dtype=float),
        again=first["again"].to_numpy(dtype=bool),
        xi=xi,
        initial_xi=runs[INITIAL_XI].to_numpy(dtype=float).reshape(-1, n, 6),
        failed=failed,
        no_covariance=no_covariance,
        wrong_basin=wrong_basin,
        no_basin=no_basin,
        noise_draw=noise_draw,
        weight=weight[0],
        covariance=covariance,
        returns=returns,
        length=length,
        far=far,
    )


def mark_wrong_basins(runs: pd.DataFrame, method: Method, length: float) -> np.ndarray:
    """Which runs (n,) of one setting of a runs table are in a wrong basin; no failed one is.

    length [m]: the pair's characteristic length.
    """
    return _basins(runs[XI].to_numpy(dtype=float), _failed(runs), method, length).wrong


def _apart(poses, xi, failed, method, length):
    """Which poses (S, K, 6) of the estimates are in a wrong basin of their setting's runs."""
    together = np.concatenate([xi, poses], axis=1)
    lost = np.concatenate([failed, np.isnan(poses).any(axis=-1)], axis=1)
    return _basins(together, lost, method, length).wrong[:, xi.shape[1] :]


def _failed(table):
    return ~table["status"].isin(GOOD_STATUS).to_numpy()


def _basins(xi, failed, method, length):
    return find_basins(np.where(failed[..., None], np.nan, xi), length, *method.basin)
