"""Pairs of scans, read from their tables."""

from icpshap import se3, tables
from icpshap.estimators import perturb as perturbation


def read_pair(reference, source, poses, overlap, indices):
    """A perturbation.Pair from the paths of its tables; indices of reference and source scan."""
    return perturbation.Pair(
        tables.read_points(reference),
        tables.read_points(source),
        relative_pose(tables.read_poses(poses), *indices),
        tables.read(overlap, "overlap")["overlapping"].to_numpy(),
    )


def relative_pose(T_global_scan, reference, source):
    """T_reference_source (4, 4) of two scans out of all poses (n, 4, 4)."""
    return se3.inverse(T_global_scan[reference]) @ T_global_scan[source]
