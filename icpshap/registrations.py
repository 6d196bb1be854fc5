"""Registrations of other libraries for estimators of the kind `callable`: to be copied, changed.

Each is a function of the reference (n, 3) and the source (m, 3) [m] and of the initial pose (4, 4);
it returns the pose (4, 4), T_reference_source, that maps source coordinates to the reference's.
One thread each: jobs are parallel by processes, and the order of sums must not vary.
"""


def small_gicp(reference, source, T_initial):
    """Generalised ICP of small_gicp on clouds thinned to a grid of 0.25 m, with links up to 1 m."""
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


def open3d(reference, source, T_initial):
    """Point-to-plane ICP of Open3D, normals from 20 neighbours, with links up to 1 m.

    Open3D uses as many threads as OMP_NUM_THREADS says, which the workflow sets to 1.
    """
    from icpshap.data.open3d_loader import load_open3d

    open3d = load_open3d()
    clouds = [
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        for points in (reference, source)
    ]
    clouds[0].estimate_normals(open3d.geometry.KDTreeSearchParamKNN(20))
    result = open3d.pipelines.registration.registration_icp(
        clouds[1],
        clouds[0],
        max_correspondence_distance=1.0,
        init=T_initial,
        estimation_method=(open3d.pipelines.registration.TransformationEstimationPointToPlane()),
    )
    return result.transformation
