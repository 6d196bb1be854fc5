"""Runs that end in a wrong basin: marked when runs are read, so that no limit registers again.

Distances between runs count a rotation by what it moves at the pair's characteristic length L, and
what is far is measured by how the setting's own runs lie, so that a wide cloud is one basin.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.explanation.patterns import alike

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


NEIGHBOUR = 5
GAP_FACTOR = 2.5
SMALLEST_GAP = 0.1  # of the translation limit; without it a tight cloud falls apart
SPREAD_FLOOR = 0.01  # of that limit; own basins of few or equal runs have no covariance to invert
# The 99.999 % quantile of chi^2 with 6 degrees of freedom: so far reaches what a spread explains. A
# basin that grew by runs further away would reach further by each, up to the next basin.
EXPLAINED_SQUARED_DISTANCE = 33.10705681683927
LARGEST_SQUARED_DISTANCE = 2 * EXPLAINED_SQUARED_DISTANCE
ELEMENTS_AT_ONCE = 400_000  # distances, of which the processor's cache holds some copies


class Basins(NamedTuple):
    """What is known of the basins of settings (...) with n runs each.

    wrong (..., n): runs in a wrong basin, never a failed one; lacking (...): the setting has no
    basin of its own, since fewer than half of the runs that did not fail lie together; not where
    all failed, which is known to be nowhere.
    """

    wrong: np.ndarray
    lacking: np.ndarray


def find_basins(xi: ArrayLike, length: float, translation: float, rotation: float) -> Basins:
    """`Basins` of settings with pose errors xi (..., n, 6) [rad, m]; a failed run is NaN.

    length [m]: the pair's characteristic length L; translation [m], rotation [rad]: the limits. The
    centre is the run whose median distance sqrt(L^2 |rotation|^2 + |translation|^2) to the others
    is least. The own basin holds the runs that single linkage joins to it below the gap: 2.5 times
    the median distance to the fifth neighbour among the half of the runs that is nearest the
    centre, and a tenth of the translation limit at least. It grows by what its own spread
    explains, until nothing is added, so that a long cloud does not break at a chance gap: by runs
    whose squared Mahalanobis distance to it is at most the 99.999 % quantile of chi^2 with 6
    degrees of freedom. A run is in a wrong basin if it lies beyond a limit from the centre, is not
    in the own basin, and its squared Mahalanobis distance to that basin exceeds twice the quantile.
    """
    xi = np.asarray(xi, dtype=float)
    flat = xi.reshape(-1, *xi.shape[-2:])
    good = ~np.isnan(flat).any(axis=-1)
    wrong, lacking = np.zeros(good.shape, dtype=bool), np.zeros(len(flat), dtype=bool)
    for kept, members in alike(good):
        number = kept.sum()
        if number == 0:
            continue
        step = max(1, ELEMENTS_AT_ONCE // number**2)
        for start in range(0, len(members), step):
            part = members[start : start + step]
            found = _basins(flat[part][:, kept], length, translation, rotation)
            wrong[np.ix_(part, kept)], lacking[part] = found
    return Basins(wrong.reshape(xi.shape[:-1]), lacking.reshape(xi.shape[:-2]))


def _basins(xi, length, translation, rotation):
    """`Basins` of settings (s, n, 6) without failed runs."""
    settings = np.arange(len(xi))
    points = xi * np.repeat([length, 1.0], 3)
    distance = _distances(points)
    nearest_first = np.sort(distance, axis=-1)  # of each run, itself the first
    centre = np.argmin(_median_of_others(nearest_first), axis=-1)
    from_centre = distance[settings, centre]
    gap = np.maximum(
        GAP_FACTOR * _typical_neighbour(nearest_first, from_centre), SMALLEST_GAP * translation
    )
    floor = SPREAD_FLOOR * translation
    own = _grown(points, _joined(distance < gap[:, None, None], centre), floor)
    away = xi - xi[settings, centre][:, None]
    far = np.linalg.norm(away[..., :3], axis=-1) > rotation
    far |= np.linalg.norm(away[..., 3:], axis=-1) > translation
    wrong = far & ~own
    doubtful = np.flatnonzero(wrong.any(axis=-1))
    wrong[doubtful] &= (
        _squared_mahalanobis(points[doubtful], own[doubtful], floor) > LARGEST_SQUARED_DISTANCE
    )
    return Basins(wrong, 2 * own.sum(axis=-1) < xi.shape[-2])


def _distances(points):
    """Distances (s, n, n) of points (s, n, 6)."""
    # About the middle: products of large numbers would hide small distances.
    centred = points - np.median(points, axis=-2, keepdims=True)
    square = np.square(centred).sum(axis=-1)
    result = centred @ np.swapaxes(centred, -1, -2)
    result *= -2.0
    result += square[:, :, None]
    result += square[:, None, :]
    np.maximum(result, 0.0, out=result)
    np.sqrt(result, out=result)
    runs = np.arange(points.shape[-2])
    result[:, runs, runs] = 0.0
    return result


def _median_of_others(nearest_first):
    others = nearest_first.shape[-1] - 1
    if others == 0:
        return nearest_first[..., 0]
    return (nearest_first[..., 1 + (others - 1) // 2] + nearest_first[..., 1 + others // 2]) / 2


def _typical_neighbour(nearest_first, from_centre):
    """Median distance (s,) to the fifth neighbour, of the runs nearest the centre."""
    number = from_centre.shape[-1]
    half = np.argsort(from_centre, axis=-1, kind="stable")[:, : (number + 1) // 2]
    neighbour = nearest_first[..., min(NEIGHBOUR, number - 1)]
    return np.median(np.take_along_axis(neighbour, half, axis=-1), axis=-1)


def _joined(linked, centre):
    """Which runs (s, n) chains of links (s, n, n) join to the centre (s,)."""
    joined = linked[np.arange(len(linked)), centre]
    joined[np.arange(len(linked)), centre] = True
    active = np.arange(len(linked))
    links = linked.astype(np.float32)
    while len(active):
        reached = (links[active] @ joined[active, :, None].astype(np.float32))[..., 0] > 0
        reached |= joined[active]
        grown = (reached != joined[active]).any(axis=-1)
        joined[active] = reached
        active = active[grown]
    return joined


def _grown(points, own, floor):
    """The own basins (s, n) with all runs that their spread explains; points (s, n, 6)."""
    own = own.copy()
    active = np.flatnonzero(~own.all(axis=-1))
    while len(active):
        inside = own[active]
        square = _squared_mahalanobis(points[active], inside, floor)
        grown = inside | (square <= EXPLAINED_SQUARED_DISTANCE)
        own[active] = grown
        active = active[(grown & ~inside).any(axis=-1) & ~grown.all(axis=-1)]
    return own


def _squared_mahalanobis(points, own, floor):
    """Squared Mahalanobis distance (s, n) of points (s, n, 6) to those marked in own (s, n)."""
    count = own.sum(axis=-1)[:, None, None]
    mean = np.where(own[..., None], points, 0.0).sum(axis=-2, keepdims=True) / count
    centred = points - mean
    inside = np.where(own[..., None], centred, 0.0)
    covariance = np.swapaxes(inside, -1, -2) @ inside / np.maximum(count - 1, 1)
    covariance += floor**2 * np.eye(points.shape[-1])
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), np.swapaxes(centred, -1, -2))
    return np.square(whitened).sum(axis=-2)
