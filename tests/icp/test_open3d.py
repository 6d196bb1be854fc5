"""The ICP engine against Open3D: 100 runs on simulated scans and, where given, on a real pair."""

import numpy as np
import pytest
from conftest import folder_in
from scipy.spatial.transform import Rotation

from icpshap import icp, se3
from icpshap.data.open3d_loader import load_open3d
from icpshap.data.poses import read_poses
from icpshap.data.scans import read_scan
from icpshap.data.simulate import simulate_poses, simulate_scan

pytestmark = pytest.mark.slow

RUNS = 100
BEAMS, SEED = 16000, 42
DISTANCE = 1.0  # m, of the longest link
ALL_LINKS = icp.Trimmed(1.0)
AT_REST = 1e-11  # rad, m in a step
# Of the initial poses, at s = 1: 10 degrees and 0.2 m, shared among three axes [rad, m].
DEVIATION = np.repeat([np.deg2rad(10.0), 0.2], 3) / np.sqrt(3.0)


def simulated_scans(scene):
    """Two scans of a scene by the tilting laser, whole, and T_reference_source."""
    T = simulate_poses(scene, 2, SEED)
    scans = [simulate_scan(scene, k, T[k], BEAMS, SEED) for k in range(2)]
    return scans, se3.inverse(T[0]) @ T[1]


def real_scans():
    folder = folder_in("ICPSHAP_REAL_DATA") / "apartment_pair"
    scans = [read_scan(folder / "csv_local" / f"Hokuyo_{k}.csv")[0] for k in (0, 1)]
    T = read_poses(folder / "leica" / "pose_scanner_leica.csv", 2)
    return scans, se3.inverse(T[0]) @ T[1]


@pytest.fixture(scope="module", params=["apartment", "stairwell", "real"])
def pair(request):
    """(reference, source, initial poses): all points beyond 1 m of the two scans.

    About the reference's centre, where the engine linearises its rotations.
    """
    scans, T = real_scans() if request.param == "real" else simulated_scans(request.param)
    reference, source = (cloud[icp.minimum_range(cloud, 1.0)] for cloud in scans)
    centre = reference.mean(axis=0)
    T[:3, 3] -= centre
    xi = np.random.default_rng(0).normal(size=(RUNS, 6)) * DEVIATION
    return reference - centre, source, T @ se3.exp(xi)


def ours(pair, minimiser, iterations, smallest_step=0.0):
    """The engine's poses after that many iterations, fewer where a run has come to rest."""
    reference, source, T_initial = pair
    stopping = icp.Stopping(iterations, smallest_step, smallest_step)
    chain = icp.Chain(minimiser, 1, ALL_LINKS, DISTANCE, stopping)
    rows = [np.arange(len(source))] * RUNS
    result = icp.register(icp.Reference(reference), source, rows, T_initial, chain)
    assert set(result.status) == {"ok" if smallest_step else "max_iterations"}
    return result.T_reference_source


def open3d_poses(pair, planes, iterations, smallest_change=0.0):
    """Open3D's poses after that many iterations, fewer where fitness and RMSE change no more."""
    open3d = load_open3d()
    registration = open3d.pipelines.registration
    reference, source, T_initial = pair
    clouds = [
        open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        for points in (source, reference)
    ]
    method = registration.TransformationEstimationPointToPoint()
    if planes:
        engine = icp.Reference(reference)
        normals = np.empty_like(reference)
        normals[engine.tree.rows] = engine.normals
        clouds[1].normals = open3d.utility.Vector3dVector(normals)
        method = registration.TransformationEstimationPointToPlane()
    criteria = registration.ICPConvergenceCriteria(smallest_change, smallest_change, iterations)
    return np.array(
        [
            registration.registration_icp(*clouds, DISTANCE, T, method, criteria).transformation
            for T in T_initial
        ]
    )


def from_poses(pair, T_initial):
    return (*pair[:2], T_initial)


@pytest.fixture
def turn_by_axes(monkeypatch):
    """Open3D turns about z, y, x in turn, the chain about one axis: here as Open3D does."""
    by_axes = type("ByAxes", (), {"from_rotvec": lambda x: Rotation.from_euler("xyz", x)})
    monkeypatch.setattr("icpshap.icp.minimisers.Rotation", by_axes)


def test_point_to_point_after_30_iterations(pair):
    np.testing.assert_allclose(
        ours(pair, icp.PointToPoint(), 30), open3d_poses(pair, False, 30), rtol=0, atol=1e-9
    )


def test_point_to_plane_after_one_step(pair, turn_by_axes):
    np.testing.assert_allclose(
        ours(pair, icp.PointToPlane(), 1), open3d_poses(pair, True, 1), rtol=0, atol=1e-9
    )


@pytest.fixture(scope="module")
def at_rest(pair):
    """Open3D's poses at 200 iterations; another step must not move them.

    Open3D stops before where nothing changes; ten more steps take it from there to rest.
    """
    T = open3d_poses(pair, True, 190, smallest_change=1e-15)
    T = open3d_poses(from_poses(pair, T), True, 10)
    np.testing.assert_allclose(open3d_poses(from_poses(pair, T), True, 1), T, rtol=0, atol=AT_REST)
    return T


def test_point_to_plane_at_rest(pair, at_rest, turn_by_axes):
    T = ours(pair, icp.PointToPlane(), 200, smallest_step=AT_REST)
    np.testing.assert_allclose(T, at_rest, rtol=0, atol=1e-9)


def test_point_to_plane_at_rest_with_its_own_update(pair, at_rest):
    """Both come to the same rest; where two are near, the other update may lead to the other.

    Then each program must rest at the pose of the other.
    """
    T = ours(pair, icp.PointToPlane(), 200, smallest_step=AT_REST)
    theirs = open3d_poses(from_poses(pair, T), True, 1)
    np.testing.assert_allclose(theirs, T, rtol=0, atol=1e-9)
    chain = ours(from_poses(pair, at_rest), icp.PointToPlane(), 1)
    np.testing.assert_allclose(chain, at_rest, rtol=0, atol=1e-9)
    difference = np.abs(T - at_rest).max(axis=(1, 2))
    assert np.count_nonzero(difference < 1e-9) >= 0.95 * RUNS
    assert difference.max() < 1e-4
