"""Geometry of point clouds that more than one part of the library needs."""

import numpy as np
from scipy.spatial import KDTree

from icpshap import se3


def search_tree(points: np.ndarray) -> KDTree:
    """A search tree of points (n, 3): cells cut in the middle are sooner made than at the median,
    and sooner searched."""
    return KDTree(points, balanced_tree=False)


def nearest_distances(
    reference: np.ndarray, source: np.ndarray, T_reference_source: np.ndarray
) -> np.ndarray:
    """Distance [m] of each source point (m, 3) to the nearest reference point at the given pose."""
    distances, _ = search_tree(reference).query(se3.transform(T_reference_source, source))
    return distances


def normals(
    points: np.ndarray, neighbours: int, rows: np.ndarray | slice = slice(None)
) -> np.ndarray:
    """Unit normals (k, 3), of either sign, at some rows of points (n, 3), by default at all.

    The direction in which the nearest `neighbours` of a point, itself included, vary least.
    """
    _, nearest = KDTree(points).query(points[rows], k=neighbours)
    _, vectors = np.linalg.eigh(scatter(points[nearest]))
    return vectors[:, :, 0]


def scatter(clouds: np.ndarray) -> np.ndarray:
    """Scatter matrices (m, 3, 3) of clouds (m, k, 3) about their means."""
    centred = clouds - clouds.mean(axis=1, keepdims=True)
    return np.einsum("mki,mkj->mij", centred, centred)


def information_rows(
    points: np.ndarray, across: np.ndarray, centre: np.ndarray, length: float
) -> np.ndarray:
    """What links at points (n, 3) [m] say of the pose: a = [(p - centre) x n / length; n] (n, 6).

    across (n, 3): unit normals n; length [m] makes turns comparable with shifts.
    """
    return np.hstack([np.cross(points - centre, across) / length, across])


def information_matrix(rows: np.ndarray) -> np.ndarray:
    """A, the sum of a a^T (6, 6) over rows (n, 6) of `information_rows`."""
    # einsum: its sum is the same on any number of threads, which that of a matrix product is not.
    return np.einsum("ni,nj->ij", rows, rows)


def nearest_to_cell_centres(points: np.ndarray, side: float) -> np.ndarray:
    """Mask (n,) of the one point of each cell of a voxel grid that is nearest to its centre.

    The grid's corners lie at whole multiples of `side` [m] in the frame of points (n, 3) [m]; of
    equally near points the first.

    >>> points = np.array([[0.1, 0.1, 0.1], [0.4, 0.5, 0.5], [1.5, 0.5, 0.5]])
    >>> nearest_to_cell_centres(points, 1.0).tolist()
    [False, True, True]
    """
    cells = np.floor(points / side)
    distance = np.square(points / side - cells - 0.5).sum(axis=1)
    order = np.lexsort((distance, *cells.T))
    cells = cells[order]
    first = np.ones(len(points), dtype=bool)
    first[1:] = (cells[1:] != cells[:-1]).any(axis=1)
    mask = np.zeros(len(points), dtype=bool)
    mask[order[first]] = True
    return mask


def root_mean_square_distance(points: np.ndarray) -> float:
    """Root mean square distance of points (n, 3) from their centroid; NaN for none."""
    if len(points) == 0:
        return np.nan
    return float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean()))
