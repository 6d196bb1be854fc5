"""Trimming: the squared length up to which the links of a run are kept, exactly, without sorting.

Idea: the threshold is one order statistic of all of a run's squared link lengths, and it moves
slowly from one iteration to the next. So a band that will contain it is predicted. Links below the
band are counted and summed as they are found, links above it are forgotten, and only the few
inside are stored; the threshold is selected among those (quickselect).

Exactness: the counts below and inside the band prove whether it contains the wanted rank; if it
does not, the run's iteration is repeated with a band that holds everything. The prediction uses
the run's own past, or at first a sample of its own links, so the band, and with it the order in
which links are summed, is the same whatever other runs are computed beside it.

Measured: docs/engine.md.
"""

import numpy as np

from icpshap.icp import pivots
from icpshap.icp.compiled import jit, jit_borrowing

SAMPLE = 1024  # links from which the first band is estimated
SAMPLE_WIDTH = 0.06  # of the band on either side of the rank, as a share of the links
STEADY = 0.25  # largest relative change of the threshold from which the next one is predicted
ROOM = 0.2  # share of a run's links that a band may hold


@jit_borrowing
def select(values: np.ndarray, count: int, rank: int) -> float:
    """The `rank`-th smallest (0-based) of values[:count], which is reordered (quickselect)."""
    low, high = 0, count - 1
    patience = pivots.PATIENCE * count
    number = pivots.FIRST
    while low < high:
        first, middle, last = low, (low + high) >> 1, high
        patience -= high - low
        if patience < 0:
            number = pivots.drawn(number)
            first = middle = last = pivots.place(number, low, high)
        a, b, c = values[first], values[middle], values[last]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return values[rank]


@jit
def sampled_bands(
    distance: np.ndarray,
    start: np.ndarray,
    count: np.ndarray,
    active: np.ndarray,
    ratio: float,
    lower: np.ndarray,
    upper: np.ndarray,
) -> None:
    """Set the active runs' bands from the lengths of a sample of their links, which is reordered.

    distance[start[run]:] holds count[run] squared lengths [m^2].
    """
    for run in active:
        values, links = distance[start[run] : start[run] + count[run]], count[run]
        below = int(links * (ratio - SAMPLE_WIDTH))
        above = int(links * (ratio + SAMPLE_WIDTH)) + 1
        upper[run] = select(values, links, above) if above < links else np.inf
        # What is above the upper end has been put behind it.
        rest = min(above, links)
        lower[run] = select(values, rest, below) if 0 < below < rest else -np.inf


def predicted_bands(
    threshold: np.ndarray, previous: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bands (lower, upper) and where to use them, (R,) each, from the last two thresholds (R,)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        change = threshold / previous
    away = np.abs(change - 1.0)
    steady = away < STEADY
    change[~steady] = 1.0
    # Thresholds level off, at times from one iteration to the next: between this change and none.
    least = np.minimum(change - 0.3 * away, 1.0 - 0.05 * away) - 0.02
    most = np.maximum(change + 0.3 * away, 1.0 + 0.05 * away) + 0.02
    return threshold * least, threshold * most, steady
