"""f of games, the uncertainty of their settings, with its interval.

A *game* is a list of settings, the clean one first, whose f belong together: the coalitions of an
instance, or clean and perturbed. Runs left out of one of its settings are left out of all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from icpshap.errors import UserError
from icpshap.explanation.intervals import Resampling, mean_interval
from icpshap.explanation.patterns import alike

if TYPE_CHECKING:
    from icpshap.explanation.method import Method
    from icpshap.explanation.sample import Sample


BOOTSTRAP_DRAWS = 1000
SETTINGS_AT_ONCE = 64


@dataclass(frozen=True)
class Estimate:
    """A quantity of i games, (i, q) each: its value, the ends of its interval, and how much more it
    varies over whole noise draws than over runs."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray
    draw_variance_ratio: np.ndarray

    def part(self, columns: slice | np.ndarray) -> Estimate:
        """The same of some columns alone."""
        return Estimate(
            self.value[:, columns],
            self.low[:, columns],
            self.high[:, columns],
            self.draw_variance_ratio[:, columns],
        )


def with_ends(estimate: Estimate, low: np.ndarray, high: np.ndarray) -> Estimate:
    """The same `Estimate` with other ends (i, q) of its interval, where it has a value."""
    low, high = (np.where(np.isnan(estimate.value), np.nan, end) for end in (low, high))
    return Estimate(estimate.value, low, high, estimate.draw_variance_ratio)


def columns_of(names: Iterable[str], estimate: Estimate) -> dict[str, np.ndarray]:
    """Columns (i,) of a table for the quantities of an `Estimate`, by their names."""
    columns: dict[str, np.ndarray] = {}
    for q, name in enumerate(names):
        value, low, high = estimate.value[:, q], estimate.low[:, q], estimate.high[:, q]
        columns |= {name: value, f"{name}_low": low, f"{name}_high": high}
    return columns


def over_replicates(found: list[Estimate]) -> Estimate:
    """Mean of the `Estimate`s of several replicates, whose spread gives its interval."""
    if len(found) == 1:
        return found[0]
    ratio = np.mean([part.draw_variance_ratio for part in found], axis=0)
    return Estimate(*mean_interval(np.array([part.value for part in found])), ratio)


def estimate(
    sample: Sample,
    games: np.ndarray,
    quantities: Callable[[np.ndarray], np.ndarray],
    method: Method,
    leave_out: bool | None = None,
    intervals: bool = True,
    values: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> Estimate:
    """Quantities of games, rows (i, g) of the sample, with intervals: an `Estimate`.

    quantities: maps f (..., g) to (..., q). leave_out: whether runs in a wrong basin are left out
    (None: as the method says). values(members, weights): f (k, g, r) of the games `members` (k,)
    under each weighting (r, n); None for the method's own. A game with too few runs left is NaN. An
    interval is widened to hold the value, which without bias correction may lie beside it.
    """
    corrected = method.bias_correction == "jackknife"
    bootstrap = BOOTSTRAP_DRAWS if intervals and method.interval == "bootstrap" else 0
    jackknife = corrected or (intervals and not bootstrap)
    width = quantities(np.zeros(games.shape[1])).shape[-1]
    value, low, high, ratio = np.full((4, len(games), width), np.nan)
    for members, plan, resamples in resampled(
        sample, games, quantities, method, jackknife, bootstrap, leave_out, values
    ):
        value[members] = plan.jackknife(resamples) if corrected else resamples[0]
        if intervals and sample.units:
            ends = plan.interval(resamples)
            low[members] = np.minimum(ends[0], value[members])
            high[members] = np.maximum(ends[1], value[members])
            ratio[members] = plan.draw_variance_ratio(resamples)
    return Estimate(value, low, high, ratio)


def resampled(
    sample: Sample,
    games: np.ndarray,
    quantities: Callable[[np.ndarray], np.ndarray],
    method: Method,
    jackknife: bool,
    bootstrap: int,
    leave_out: bool | None = None,
    values: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> Iterator[tuple[np.ndarray, Resampling, np.ndarray]]:
    """Resamples of the quantities of games (i, g), for all games that keep the same runs at once.

    Yields members (k,), numbers of games; their `Resampling`; values (r, k, q). Games with too few
    runs left are passed over. Arguments as of `estimate`.
    """
    values = values or _own_values(sample, games, method)
    exchangeable = sample.returns.exchangeable
    for kept, members in alike(kept_runs(sample, games, method, leave_out)):
        if kept.sum() < sample.fewest:
            continue
        plan = Resampling.of(
            kept, sample.noise_draw, jackknife, bootstrap, method.seed, exchangeable
        )
        by_game = values(members, plan.weights)
        yield members, plan, quantities(np.moveaxis(by_game, -1, 0))


def kept_runs(
    sample: Sample, games: np.ndarray, method: Method, leave_out: bool | None = None
) -> np.ndarray:
    """Which runs stay in each game (i, g): bool (i, n)."""
    number = sample.xi.shape[1]
    reading = method.reading
    if reading.needs_samples and not sample.returns.samples:
        return np.zeros((len(games), number), dtype=bool)
    if reading.counts_failed:
        return np.ones((len(games), number), dtype=bool)
    if leave_out is None:
        leave_out = method.leaves_out_wrong_basins and not reading.bounded
    dropped = sample.lost if leave_out else sample.failed
    if reading.compares_with_clean:  # as those of covariances do
        dropped = dropped | sample.no_covariance
    return ~dropped[games].any(axis=1)


def covariances(
    replicates: list[Sample], rows: list[np.ndarray], place: int, method: Method
) -> np.ndarray:
    """Covariances (i, 6, 6) of the settings at a place of games, of the runs that f is read off.

    replicates: list of samples, of which it is the mean; rows (i, g): of each, the settings of the
    games; rotation first [rad, m], with the covariance floor. NaN where too few runs are left.
    """
    mean = np.zeros((len(rows[0]), 6, 6))
    for sample, games in zip(replicates, rows, strict=True):
        found = np.full_like(mean, np.nan)
        for kept, members in alike(kept_runs(sample, games, method)):
            if kept.sum() >= sample.fewest:
                weights = kept[None].astype(float)
                settings = games[members, place]
                found[members] = sample.spread(settings, weights, method).covariance[:, 0]
        mean += found / len(replicates)
    return mean


def _own_values(sample, games, method):
    """f by the method's reading, each setting once however many games share it."""

    def values(members, weights):
        rows, inverse = np.unique(games[members], return_inverse=True)
        f = evaluate(sample, rows, games[0, 0], weights, method)
        return f[inverse.reshape(-1, games.shape[1])]

    return values


def mean_of_games(
    number: str, sample: Sample, games: np.ndarray
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """values(members, weights) for `estimate`: means of a number of the runs, each setting once."""

    def values(members, weights):
        settings, inverse = np.unique(games[members], return_inverse=True)
        return sample.mean(number, settings, weights)[inverse.reshape(-1, games.shape[1])]

    return values


def evaluate(
    sample: Sample, rows: np.ndarray, clean: int | np.integer, weights: np.ndarray, method: Method
) -> np.ndarray:
    """f of settings `rows` (s,) against setting `clean`, under each weighting (r, n): (s, r).

    rows: ascending. Raises UserError if a covariance is singular.
    """
    # The tables of settings and of instances mostly ask for the same resamples of the same f.
    key = (method.divergence, method.bias_correction, method.floor, int(clean), weights.tobytes())
    if len(weights) > 1 and sample.last_f.get("key") == key:
        known, f = sample.last_f["rows"], sample.last_f["f"]
        if np.isin(rows, known).all():
            return f[np.searchsorted(known, rows)]
    unbiased = method.bias_correction == "wishart"
    reference = sample.spread(clean, weights, method)
    result = np.empty((len(rows), len(weights)))
    for start in range(0, len(rows), SETTINGS_AT_ONCE):
        part = slice(start, start + SETTINGS_AT_ONCE)
        perturbed = sample.spread(rows[part], weights, method)
        try:
            result[part] = method.reading.evaluate(reference, perturbed, unbiased)
        except np.linalg.LinAlgError as error:
            raise UserError(
                "The covariance of a setting is singular: its runs do not differ in some direction,"
                " as of a registration that always answers the same."
                "\nHint: see what it answers from two initial poses; or set "
                "covariance_floor_rotation and covariance_floor_translation above 0."
            ) from error
    if method.reading.compares_with_clean:
        result[rows == clean] = 0.0  # no estimate: it has neither bias nor round-off
    if len(weights) > 1:
        sample.last_f.update(key=key, rows=rows, f=result)
    return result


def perturbed(game: np.ndarray) -> np.ndarray:
    """The quantity f itself of games (..., 2): of the perturbed setting."""
    return game[..., 1:]
