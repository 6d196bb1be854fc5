"""Registrations of other libraries for estimators of the kind `callable`: to be copied, changed.

Each is a function of the reference (n, 3) and the source (m, 3) [m] and of the initial pose (4, 4);
it returns the pose (4, 4), T_reference_source, that maps source coordinates to the reference's.
One thread each: jobs are parallel by processes, and the order of sums must not vary.
"""

from functools import lru_cache

import numpy as np


def small_gicp(reference: np.ndarray, source: np.ndarray, T_initial: np.ndarray) -> np.ndarray:
    """Generalised ICP of small_gicp on clouds on a grid of 0.25 m, links up to 1 m: (4, 4)."""
    import small_gicp

    result = small_gicp.align(
        reference,
        source,
        T_initial,
        registration_type="GICP",
        downsampling_resolution=0.25,
        max_correspondence_distance=1.0,
        num_threads=1,
    )
    return result.T_target_source


def open3d(reference: np.ndarray, source: np.ndarray, T_initial: np.ndarray) -> np.ndarray:
    """Point-to-plane ICP of Open3D, normals from 20 neighbours, links up to 1 m: (4, 4).

    Open3D uses as many threads as OMP_NUM_THREADS says, which the workflow sets to 1.
    """
    from icpshap.data.open3d_loader import load_open3d

    open3d = load_open3d()
    result = open3d.pipelines.registration.registration_icp(
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(source)),
        _with_normals(np.asarray(reference, dtype=float).tobytes()),
        max_correspondence_distance=1.0,
        init=T_initial,
        estimation_method=open3d.pipelines.registration.TransformationEstimationPointToPlane(),
    )
    return result.transformation


@lru_cache(maxsize=1)
def _with_normals(points):
    """Open3D's cloud of points, the bytes of float64 (n, 3), with normals.

    Kept for the next call: many have the same reference, each a copy of its own.
    """
    from icpshap.data.open3d_loader import load_open3d

    open3d = load_open3d()
    array = np.frombuffer(points).reshape(-1, 3).copy()  # Open3D takes none that is read-only
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(array))
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamKNN(20))
    return cloud
