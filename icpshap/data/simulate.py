"""Simulated scans of built-in scenes by a laser scanner, with exact poses.

Tilting, like a Hokuyo UTM-30LX: a fan of 270 degrees, swept by a tilt about its lateral axis, 30 m
range, and returns from the robot that carries it. Spinning, like an Ouster OS1: rings over 45
degrees, 100 m range, ten turns a second, on a mast from which it sees no robot; it may move ahead
while it turns. Both have range noise and dropouts. The scanner frame has x forward, y to the left,
z up. Rays are cast by Open3D's RaycastingScene.
"""

from collections.abc import Callable
from typing import NamedTuple
from zlib import crc32

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from icpshap.data.open3d_loader import load_open3d
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
SENSOR_HEIGHT = 1.0  # m above the ground


class Scene(NamedTuple):
    """``build`` makes the triangle meshes, ``path`` (k, 3) [m] is where the scanner travels."""

    build: Callable
    path: np.ndarray


def maximum_scans(scene):
    """How many scans the path through a scene holds for certain."""
    return int(_path_length(SCENES[scene].path)[-1] / STEP[1]) + 1


def simulate_poses(scene, scans, seed):
    """Poses T_global_scan (scans, 4, 4) along the path through a scene.

    Pose k depends on scene, seed and k alone. Raises UserError for more than `maximum_scans`.
    """
    if scans > maximum_scans(scene):
        raise UserError(
            f"scans: {scans} do not fit on the path through the scene {scene!r}, at most"
            f" {maximum_scans(scene)} do.\nHint: lower `scans`."
        )
    return _poses(SCENES[scene].path, scans, _generator(seed, scene, "motion"))


def simulate_scan(
    scene, index, T_global_scan, beams, seed, range_noise=None, rings=None, speed=0.0
):
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
        noise = RING_NOISE if range_noise is None else range_noise
        return _turn(world, rings, beams // rings, T_global_scan, generator, noise, speed)
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


# Meshes


def _box(open3d, low, high):
    low, size = np.array(low, dtype=float), np.subtract(high, low)
    return open3d.geometry.TriangleMesh.create_box(*size).translate(low)


def _cylinder(open3d, base, radius, height):
    mesh = open3d.geometry.TriangleMesh.create_cylinder(radius, height, resolution=16, split=1)
    return mesh.translate(np.add(base, (0, 0, height / 2)))


def _sphere(open3d, centre, radius):
    return open3d.geometry.TriangleMesh.create_sphere(radius, resolution=12).translate(centre)


def _robot(open3d):
    """The robot below the scanner and the scanner's mast behind it, in the scanner frame."""
    return [
        _box(open3d, (-0.55, -0.30, -0.80), (0.25, 0.30, -0.45)),
        _box(open3d, (-0.30, -0.06, -0.45), (-0.20, 0.06, 0.10)),
    ]


# Apartment: four furnished rooms, 10 m x 8 m


def _wall(open3d, start, end, height, openings=()):
    """Wall along x or y; ``openings``: (from, to, bottom, top) along it, in metres of that axis."""
    axis = int(start[0] == end[0])

    def piece(low, high, bottom, top):
        lows, highs = np.array([*start, bottom]), np.array([*start, top])
        lows[axis], highs[axis] = low, high
        lows[1 - axis] -= 0.05
        highs[1 - axis] += 0.05
        return _box(open3d, lows, highs)

    pieces, position = [], start[axis]
    for low, high, bottom, top in openings:
        pieces.append(piece(position, low, 0.0, height))
        pieces.append(piece(low, high, top, height))
        if bottom > 0:
            pieces.append(piece(low, high, 0.0, bottom))
        position = high
    return [*pieces, piece(position, end[axis], 0.0, height)]


def _table(open3d, low, high, height):
    """A top on four legs above the rectangle from ``low`` to ``high``."""
    legs = [
        _box(open3d, (x, y, 0.0), (x + 0.06, y + 0.06, height - 0.04))
        for x in (low[0], high[0] - 0.06)
        for y in (low[1], high[1] - 0.06)
    ]
    return [*legs, _box(open3d, (*low, height - 0.04), (*high, height))]


def _chair(open3d, x, y):
    seat = _table(open3d, (x, y), (x + 0.42, y + 0.42), 0.46)
    return [*seat, _box(open3d, (x, y, 0.46), (x + 0.04, y + 0.42, 0.95))]


def _shelf(open3d, low, high, height):
    """A bookcase: sides, boards every 0.4 m, open in between."""
    (x0, y0), (x1, y1) = low, high
    boards = [_box(open3d, (x0, y0, z), (x1, y1, z + 0.03)) for z in np.arange(0.05, height, 0.4)]
    if x1 - x0 > y1 - y0:
        sides = [((x0, y0), (x0 + 0.03, y1)), ((x1 - 0.03, y0), (x1, y1))]
    else:
        sides = [((x0, y0), (x1, y0 + 0.03)), ((x0, y1 - 0.03), (x1, y1))]
    return boards + [_box(open3d, (*a, 0.0), (*b, height)) for a, b in sides]


def _apartment(open3d):
    height, door, window = 2.6, (0.0, 2.0), (0.9, 2.1)
    meshes = [
        _box(open3d, (-0.1, -0.1, -0.1), (10.1, 8.1, 0.0)),
        _box(open3d, (-0.1, -0.1, height), (10.1, 8.1, height + 0.1)),
        *_wall(open3d, (0.0, 0.0), (10.0, 0.0), height, [(1.5, 3.5, *window), (7.2, 8.6, *window)]),
        *_wall(open3d, (0.0, 8.0), (10.0, 8.0), height, [(1.0, 2.2, *window), (8.0, 9.2, *window)]),
        *_wall(open3d, (0.0, 0.0), (0.0, 8.0), height),
        *_wall(open3d, (10.0, 0.0), (10.0, 8.0), height),
        *_wall(open3d, (6.0, 0.0), (6.0, 8.0), height, [(2.0, 2.9, *door), (6.2, 7.1, *door)]),
        *_wall(open3d, (0.0, 5.0), (6.0, 5.0), height, [(2.5, 4.0, *door)]),
        *_wall(open3d, (6.0, 4.5), (10.0, 4.5), height, [(7.5, 8.4, *door)]),
    ]
    living_room = [
        _box(open3d, (0.1, 2.2, 0.0), (0.9, 4.2, 0.42)),  # sofa
        _box(open3d, (0.1, 2.2, 0.42), (0.3, 4.2, 0.85)),
        *_table(open3d, (1.2, 4.2), (1.9, 4.8), 0.45),
        *_shelf(open3d, (4.3, 4.6), (5.8, 4.93), 2.1),
        _box(open3d, (4.9, 0.1, 0.0), (5.9, 0.5, 0.75)),  # sideboard
        _box(open3d, (5.1, 0.15, 0.8), (5.8, 0.2, 1.25)),  # television
        _cylinder(open3d, (0.4, 0.5, 0.0), 0.18, 0.4),  # plant
        _sphere(open3d, (0.4, 0.5, 0.75), 0.38),
    ]
    kitchen = [
        _box(open3d, (0.1, 7.4, 0.0), (3.6, 7.93, 0.9)),
        _box(open3d, (2.6, 7.6, 1.4), (4.2, 7.93, 2.1)),
        _box(open3d, (4.9, 7.3, 0.0), (5.6, 7.93, 1.9)),  # refrigerator
        *_table(open3d, (0.4, 5.5), (1.8, 6.4), 0.74),
        *_chair(open3d, 1.9, 5.7),
        *_chair(open3d, 0.8, 6.5),
    ]
    bedroom = [
        _box(open3d, (8.3, 0.5, 0.0), (9.9, 1.9, 0.5)),  # bed
        _box(open3d, (9.8, 0.4, 0.0), (9.93, 2.0, 1.0)),
        _box(open3d, (9.3, 2.6, 0.0), (9.93, 4.3, 2.1)),  # wardrobe
        *_table(open3d, (6.15, 0.2), (7.0, 1.1), 0.74),
    ]
    study = [
        *_table(open3d, (8.9, 5.2), (9.7, 6.9), 0.74),
        *_chair(open3d, 8.4, 5.6),
        *_shelf(open3d, (6.1, 4.9), (6.43, 6.0), 2.1),
        _box(open3d, (6.3, 7.5, 0.0), (7.5, 7.93, 1.2)),
    ]
    return [*meshes, *living_room, *kitchen, *bedroom, *study]


APARTMENT_PATH = [
    (1.5, 1.2), (3.8, 1.6), (6.0, 2.45), (7.6, 2.8), (7.95, 4.5), (7.7, 6.1),
    (6.0, 6.65), (4.0, 6.4), (3.2, 5.0), (2.8, 3.4), (1.6, 1.8),
]  # fmt: skip


# Stairwell: a shaft with three storeys of two flights each

FLIGHT_STEPS, RISE, TREAD = 9, 0.17, 0.28  # m
LANDING, FLIGHT_WIDTH, WELL = 2.2, 2.2, 0.4  # m; the well is the gap between the flights
STOREYS = 3
HALF_STOREY = FLIGHT_STEPS * RISE
FLIGHT_LENGTH = FLIGHT_STEPS * TREAD
STAIR_WIDTH = 2 * FLIGHT_WIDTH + WELL
STAIR_LENGTH = 2 * LANDING + FLIGHT_LENGTH


def _stairwell(open3d):
    top = 2 * STOREYS * HALF_STOREY + 2.6
    far = LANDING + FLIGHT_LENGTH
    meshes = [
        _box(open3d, (0, 0, -0.1), (STAIR_WIDTH, STAIR_LENGTH, 0.0)),
        _box(open3d, (0, 0, top), (STAIR_WIDTH, STAIR_LENGTH, top + 0.1)),
        *_wall(open3d, (0.0, 0.0), (0.0, STAIR_LENGTH), top),
        *_wall(open3d, (STAIR_WIDTH, 0.0), (STAIR_WIDTH, STAIR_LENGTH), top),
        *_wall(open3d, (0.0, 0.0), (STAIR_WIDTH, 0.0), top),
        *_wall(open3d, (0.0, STAIR_LENGTH), (STAIR_WIDTH, STAIR_LENGTH), top),
    ]
    for half in range(2 * STOREYS):
        ground = half * HALF_STOREY
        upward = half % 2 == 0  # this flight leads to the far landing, on the low-x side
        left = 0.0 if upward else FLIGHT_WIDTH + WELL
        rail = FLIGHT_WIDTH if upward else FLIGHT_WIDTH + WELL - 0.04
        for step in range(FLIGHT_STEPS):
            y = LANDING + TREAD * step if upward else far - TREAD * (step + 1)
            z = ground + RISE * (step + 1)
            meshes.append(_box(open3d, (left, y, z - 0.2), (left + FLIGHT_WIDTH, y + TREAD, z)))
            meshes.append(_box(open3d, (rail, y + 0.12, z), (rail + 0.04, y + 0.16, z + 0.95)))
        z = ground + HALF_STOREY
        start = far if upward else 0.0
        meshes.append(_box(open3d, (0, start, z - 0.2), (STAIR_WIDTH, start + LANDING, z)))
    for storey in range(STOREYS + 1):
        z = 2 * storey * HALF_STOREY
        meshes.append(_box(open3d, (1.0, 0.05, z), (1.9, 0.12, z + 2.0)))  # door
        meshes.append(_box(open3d, (0.05, 0.3, z), (0.35, 0.9, z + 0.8)))  # radiator
    return meshes


def _stairwell_path():
    left, right = 0.65 * FLIGHT_WIDTH, STAIR_WIDTH - 0.65 * FLIGHT_WIDTH
    near, far = LANDING, LANDING + FLIGHT_LENGTH
    corners = [(left + 0.3, near - 1.1, 0.0)]
    for half in range(2 * STOREYS):
        low, high = half * HALF_STOREY, (half + 1) * HALF_STOREY
        if half % 2 == 0:
            turn = (STAIR_WIDTH / 2, far + 1.1, high)
            corners += [(left, near, low), (left, far, high), turn]
        else:
            turn = (STAIR_WIDTH / 2, near - 1.1, high)
            corners += [(right, far, low), (right, near, high), turn]
    return np.array(corners) + np.array([0, 0, SENSOR_HEIGHT])


# Plain: rolling ground with a few trees and rocks

PLAIN_SIZE = 90.0  # m
TREES = [(-6, 5), (-2, -7), (4, 9), (9, -4), (14, 6), (19, -9), (22, 3), (-13, -3), (30, 12)]
ROCKS = [(-4, -2.5), (2, 4), (7, -7), (12, 2.5), (16, -3), (24, -6)]


def _ground_height(x, y):
    """Height [m] of the plain: gentle waves and a slope that rises at its edge."""
    waves = 0.5 * np.sin(0.21 * x + 0.3) * np.cos(0.17 * y) + 0.12 * np.sin(0.9 * x + 0.7 * y)
    edge = np.maximum(np.hypot(x - 6, y) - 14, 0)
    return waves + 0.02 * edge**1.6


def _plain(open3d):
    ticks = np.arange(-PLAIN_SIZE / 2, PLAIN_SIZE / 2 + 1)
    x, y = np.meshgrid(ticks, ticks, indexing="ij")
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (
        part.ravel()
        for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:])
    )
    ground = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(np.stack([x, y, _ground_height(x, y)], -1).reshape(-1, 3)),
        open3d.utility.Vector3iVector(
            np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)])
        ),
    )
    meshes = [ground]
    for index, (x, y) in enumerate(TREES):
        base = (x, y, _ground_height(x, y) - 0.2)
        trunk = 2.0 + 0.3 * (index % 4)
        meshes.append(_cylinder(open3d, base, 0.15 + 0.03 * (index % 3), trunk))
        meshes.append(_sphere(open3d, np.add(base, (0, 0, trunk + 1.0)), 1.3 + 0.2 * (index % 3)))
    for index, (x, y) in enumerate(ROCKS):
        meshes.append(_sphere(open3d, (x, y, _ground_height(x, y)), 0.35 + 0.15 * (index % 3)))
    return meshes


def _on_the_ground(corners):
    x, y = np.array(corners, dtype=float).T
    return np.stack([x, y, _ground_height(x, y) + SENSOR_HEIGHT], axis=-1)


SCENES = {
    "apartment": Scene(_apartment, np.array([(x, y, SENSOR_HEIGHT) for x, y in APARTMENT_PATH])),
    "stairwell": Scene(_stairwell, _stairwell_path()),
    "plain": Scene(
        _plain,
        _on_the_ground([(-5, 1), (-2, 0), (1, 1), (4, 2), (7, 1), (10, -1), (14, 0), (18, 1)]),
    ),
}
