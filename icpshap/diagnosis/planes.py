"""The planes that a scan shows, whichever scanner made it.

Neighbours grow in number until they span a plane. The ten nearest of a point lie on one ring of a
spinning scanner, that is, on a cone through the scanner: they have no normal, and no distance from
their plane that noise along the beams would change. And where noise is as large as a neighbourhood,
its least extent says nothing of the plane.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.geometry import scatter, search_tree

if TYPE_CHECKING:
    from scipy.spatial import KDTree


NEIGHBOURS = (10, 20, 40, 80)  # that are tried, the point itself included
LINE = 0.1  # second extent of the bearings of neighbours against their first: below, one ring
WIDTH = 3.0  # second extent of neighbours against their third: below, they are no wider than thick


class Planes(NamedTuple):
    """Unit normals (k, 3) of either sign, and residuals (k,) [m]; NaN where there is no plane.

    A residual is the root mean square distance of the neighbours from their plane.
    """

    normals: np.ndarray
    residuals: np.ndarray


def planes(points: np.ndarray, rows: np.ndarray, tree: KDTree | None = None) -> Planes:
    """The `Planes` at some rows of points (n, 3) [m], which are in their scanner's frame.

    tree: the search tree of the points, where it is known.
    """
    tree = search_tree(points) if tree is None else tree
    bearings = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
    normals, residuals = np.full((len(rows), 3), np.nan), np.full(len(rows), np.nan)
    places = np.arange(len(rows))
    for number in NEIGHBOURS:
        if number > len(points) or len(places) == 0:
            break
        _, nearest = tree.query(points[rows[places]], number)
        squares, axes = np.linalg.eigh(scatter(points[nearest]))
        found = np.ones(len(places), dtype=bool)
        if number < NEIGHBOURS[-1]:
            found = squares[:, 1] > WIDTH**2 * squares[:, 0]
        on_bearings = np.linalg.eigvalsh(scatter(bearings[nearest[found]]))
        found[found] = on_bearings[:, 1] > LINE**2 * on_bearings[:, 2]
        normals[places[found]] = axes[found, :, 0]
        mean = np.maximum(squares[found, 0], 0.0) / (number - 3)  # three numbers make a plane
        residuals[places[found]] = np.sqrt(mean)
        places = places[~found]
    return Planes(normals, residuals)
