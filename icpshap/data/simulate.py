"""Simulated scans of built-in scenes by a laser scanner, with exact poses.

Tilting, like a Hokuyo UTM-30LX: a fan of 270 degrees, swept by a tilt about its lateral axis, 30 m
range, and returns from the robot that carries it. Spinning, like an Ouster OS1: rings over 45
degrees, 100 m range, ten turns a second, on a mast from which it sees no robot; it may move ahead
while it turns. Both have range noise and dropouts. The scanner frame has x forward, y to the left,
z up. Rays are cast by Open3D's RaycastingScene.
"""

from collections.abc import Sequence
from zlib import crc32

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from icpshap.data.open3d_loader import load_open3d
from icpshap.data.scenes import SCENES
from icpshap.data.scenes._parts import box
from icpshap.errors import UserError

FAN = np.deg2rad(270.0)
FULL_RESOLUTION = (340, 1081)  # fans, beams a fan: the 367,000 beams of the data set's scans
TILT = np.deg2rad(75.0)  # up and down
MINIMUM_RANGE, MAXIMUM_RANGE = 0.1, 30.0  # m
RANGE_NOISE = (0.01, 0.03)  # m, standard deviation below and above 10 m (UTM-30LX data sheet)
DROPOUTS = 0.01  # share of the beams that return nothing
RING_SPREAD = np.deg2rad(45.0)  # between the lowest and the highest ring, the horizon amid them
RING_RANGE = (0.5, 100.0)  # m
RING_NOISE = 0.02  # m
TURN = 0.1  # s
STEP = (0.3, 0.7)  # m of path between consecutive scans
ATTITUDE_NOISE = np.deg2rad([1.0, 1.0, 5.0])  # roll, pitch, yaw about the path's direction


def maximum_scans(scene: str) -> int:
    """How many scans the path through a scene holds for certain."""
    return int(_path_length(SCENES[scene].PATH)[-1] / STEP[1]) + 1


def simulate_poses(scene: str, scans: int, seed: int) -> np.ndarray:
    """Poses T_global_scan (scans, 4, 4) along the path through a scene.

    Pose k depends on scene, seed and k alone. Raises UserError for more than `maximum_scans`.
    """
    if scans > maximum_scans(scene):
        raise UserError(
            f"scans: {scans} do not fit on the path through the scene {scene!r}, at most"
            f" {maximum_scans(scene)} do.\nHint: lower `scans`."
        )
    return _poses(SCENES[scene].PATH, scans, _generator(seed, scene, "motion"))


def simulate_scan(
    scene: str,
    index: int,
    T_global_scan: np.ndarray,
    beams: int,
    seed: int,
    range_noise: Sequence[float] | float | None = None,
    rings: int | None = None,
    speed: float = 0.0,
) -> np.ndarray:
    """Points (n, 3) [m] of scan ``index`` of a scene, in its scanner's frame.

    rings: of a spinning scanner; None for the tilting laser, of which ``beams`` beams are drawn out
    of a full scan, as one thins a cloud at random. n is less, since some are dropped, and the sky
    returns none. range_noise [m]: standard deviation of a range, of the tilting laser below and
    above 10 m; None for what the scanner has. speed [m/s]: along x while the spinning scanner
    turns; T_global_scan is its pose in the middle of the turn. Raises UserError for more beams than
    a full scan has.
    """
    open3d = load_open3d()
    world = _raycaster(open3d, SCENES[scene].build(open3d))
    if rings is not None:
        generator = _generator(seed, scene, f"spinning/{index}")
        ring_noise = RING_NOISE if range_noise is None else range_noise
        return _turn(world, rings, beams // rings, T_global_scan, generator, ring_noise, speed)
    full = _beam_directions()
    if beams > len(full):
        raise UserError(
            f"beams: {beams} are more than the {len(full)} of a full scan.\nHint: lower `beams`."
        )
    generator = _generator(seed, scene, f"laser/{index}")
    drawn = np.sort(generator.choice(len(full), beams, replace=False))
    robot = _raycaster(open3d, _robot(open3d))
    noise = RANGE_NOISE if range_noise is None else np.broadcast_to(range_noise, 2)
    return _scan(world, robot, full[drawn], T_global_scan, generator, noise)


def _generator(seed, scene, name):
    return np.random.default_rng(
        np.random.SeedSequence([seed, crc32(scene.encode()), crc32(name.encode())])
    )


# The laser


def _beam_directions():
    """Unit vectors (n, 3) of the beams of a full scan, in the scanner's frame, fan by fan."""
    fans, beams = FULL_RESOLUTION
    tilt = np.linspace(-TILT, TILT, fans)[:, None]
    angle = np.linspace(-FAN / 2, FAN / 2, beams)
    forward = np.cos(angle)
    directions = np.broadcast_arrays(
        np.cos(tilt) * forward, np.sin(angle) + 0 * tilt, -np.sin(tilt) * forward
    )
    return np.stack(directions, axis=-1).reshape(-1, 3)


def _scan(world, robot, directions, T_global_scan, generator, range_noise):
    """Points (n, 3) in the scanner frame of one scan."""
    noise = generator.standard_normal(len(directions))
    dropped = generator.random(len(directions)) < DROPOUTS
    origin = np.broadcast_to(T_global_scan[:3, 3], directions.shape)
    ranges = np.minimum(
        _cast(world, origin, directions @ T_global_scan[:3, :3].T),
        _cast(robot, np.zeros_like(directions), directions),
    )
    ranges += noise * np.where(ranges < 10.0, *range_noise)
    returned = (ranges > MINIMUM_RANGE) & (ranges < MAXIMUM_RANGE) & ~dropped
    return ranges[returned, None] * directions[returned]


def _turn(world, rings, columns, T_global_scan, generator, range_noise, speed):
    """Points (n, 3) in the scanner frame of one turn, column by column from behind.

    As a scanner's driver has them that knows nothing of its motion: of each column in the frame
    that the scanner has then.
    """
    elevation = np.linspace(RING_SPREAD / 2, -RING_SPREAD / 2, rings)
    azimuth = np.pi - 2 * np.pi * np.arange(columns)[:, None] / columns
    parts = np.broadcast_arrays(
        np.cos(elevation) * np.cos(azimuth),
        np.cos(elevation) * np.sin(azimuth),
        np.sin(elevation) + 0 * azimuth,
    )
    directions = np.stack(parts, axis=-1).reshape(-1, 3)
    time = np.repeat(TURN * ((np.arange(columns) + 0.5) / columns - 0.5), rings)
    ahead = speed * time[:, None] * T_global_scan[:3, 0]
    noise = generator.standard_normal(len(directions))
    dropped = generator.random(len(directions)) < DROPOUTS
    ranges = _cast(world, T_global_scan[:3, 3] + ahead, directions @ T_global_scan[:3, :3].T)
    ranges += noise * range_noise
    returned = (ranges > RING_RANGE[0]) & (ranges < RING_RANGE[1]) & ~dropped
    return ranges[returned, None] * directions[returned]


def _cast(raycaster, origins, directions):
    """Distance [m] to the first surface along each ray; infinite if there is none."""
    rays = np.hstack([origins, directions]).astype(np.float32)
    # One thread: a job uses no more than it was given.
    return raycaster.cast_rays(rays, nthreads=1)["t_hit"].numpy().astype(float)


def _raycaster(open3d, meshes):
    scene = open3d.t.geometry.RaycastingScene(nthreads=1)
    for mesh in meshes:
        scene.add_triangles(open3d.t.geometry.TriangleMesh.from_legacy(mesh))
    return scene


# Motion


def _path_length(path):
    """Distance [m] travelled up to each corner of a path (k, 3)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def _poses(path, scans, generator):
    """Poses T_global_scan (scans, 4, 4) along a smooth curve through the corners of the path."""
    draws = generator.random((scans, 4))
    travelled = np.cumsum(STEP[0] + draws[:, 0] * (STEP[1] - STEP[0]))
    travelled -= travelled[0]
    curve = CubicSpline(_path_length(path), path)
    fine = np.linspace(0.0, curve.x[-1], 100 * len(path))
    parameter = np.interp(travelled, _path_length(curve(fine)), fine)
    forward = curve(parameter, 1)
    roll, pitch, yaw = (2 * draws[:, 1:] - 1).T * ATTITUDE_NOISE[:, None]
    yaw += np.arctan2(forward[:, 1], forward[:, 0])
    poses = np.tile(np.eye(4), (scans, 1, 1))
    poses[:, :3, :3] = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], -1)).as_matrix()
    poses[:, :3, 3] = curve(parameter)
    return poses


def _robot(open3d):
    """The robot below the scanner and the scanner's mast behind it, in the scanner frame."""
    return [
        box(open3d, (-0.55, -0.30, -0.80), (0.25, 0.30, -0.45)),
        box(open3d, (-0.30, -0.06, -0.45), (-0.20, 0.06, 0.10)),
    ]
