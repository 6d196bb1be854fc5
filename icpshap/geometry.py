"""Geometry of point clouds that more than one part of the library needs."""

from scipy.spatial import KDTree

from icpshap import se3


def nearest_distances(reference, source, T_reference_source):
    """Distance [m] of each source point (m, 3) to the nearest reference point at the given pose."""
    distances, _ = KDTree(reference).query(se3.transform(T_reference_source, source))
    return distances
