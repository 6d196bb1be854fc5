"""Geometry of point clouds that more than one part of the library needs."""

import numpy as np
from scipy.spatial import KDTree

from icpshap import se3


def nearest_distances(reference, source, T_reference_source):
    """Distance [m] of each source point (m, 3) to the nearest reference point at the given pose."""
    distances, _ = KDTree(reference).query(se3.transform(T_reference_source, source))
    return distances


def normals(points, neighbours):
    """Unit normals (n, 3) of points (n, 3), of either sign.

    The direction in which the nearest `neighbours` of a point, itself included, vary least.
    """
    _, nearest = KDTree(points).query(points, k=neighbours)
    around = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    return vectors[:, :, 0]


def root_mean_square_distance(points):
    """Root mean square distance of points (n, 3) from their centroid; NaN for none."""
    if len(points) == 0:
        return np.nan
    return float(np.sqrt(np.square(points - points.mean(axis=0)).sum(axis=1).mean()))
