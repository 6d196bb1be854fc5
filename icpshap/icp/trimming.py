"""Trimming: the squared length up to which the links of a run are kept, exactly, without sorting.

Idea: the threshold is one order statistic of all of a run's squared link lengths, and it moves
slowly from one iteration to the next. So a band that will contain it is predicted. Links below the
band are counted and summed as they are found, links above it are forgotten, and only the few
inside are stored; the threshold is selected among those (`selection`).

Exactness: the counts below and inside the band prove whether it contains the wanted rank; if it
does not, the run's iteration is repeated with a band that holds everything. The prediction uses
the run's own past, or at first a sample of its own links, so the band, and with it the order in
which links are summed, is the same whatever other runs are computed beside it.

Measured: docs/engine.md.
"""

import numpy as np

from icpshap.icp.compiled import Array, jit
from icpshap.icp.selection import select

SAMPLE = 1024  # links from which the first band is estimated
SAMPLE_WIDTH = 0.06  # of the band on either side of the rank, as a share of the links
STEADY = 0.25  # largest relative change of the threshold from which the next one is predicted
ROOM = 0.2  # share of a run's links that a band may hold


@jit
def sampled_bands(
    distance: Array,
    start: Array,
    count: Array,
    active: Array,
    ratio: float,
    lower: Array,
    upper: Array,
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


def predicted_bands(threshold: Array, previous: Array) -> tuple[Array, Array, Array]:
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
