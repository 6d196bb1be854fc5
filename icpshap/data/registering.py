"""Poses where there are none: two scans are registered, and ICP's answer is taken as the truth.

What is thinned, matched and cut off follows from the size of the scene, so that an office and a
street take the same settings. The answer is checked as far as two scans allow.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from icpshap import icp, se3
from icpshap.data.ground_truth import OVERLAP_DISTANCE, ROBOT
from icpshap.data.scans import MINIMUM_POINTS
from icpshap.errors import DataError
from icpshap.geometry import nearest_distances

log = logging.getLogger(__name__)

TRUTH = (
    "the true pose is what ICP itself answered (`poses: register`): errors are relative to that"
    " answer, and a bias that ICP has on these scans is hidden"
)
VOXELS = 40  # in the median range of a scan
SMALLEST_VOXEL, LARGEST_VOXEL = 0.02, 0.25  # m
NEIGHBOURS = 20  # of a normal: enough to leave one ring of a spinning scanner
MATCHES = 3
KEPT_LINKS = 0.7
DISTANCES = (None, 20, 5)  # of links at most, in voxels, from coarse to fine; None: no limit
STEP = 1e-3  # rad and m, mean of the last three at which the finest stops
ITERATIONS = 150  # of each
# Where ICP starts besides the guess itself: turned, moved along an axis [rad, voxels].
OFFSETS = np.vstack(
    [np.zeros(6), *(sign * row for row in np.diag(3 * [0.2] + 3 * [10.0]) for sign in (1, -1))]
)
MINIMUM_OVERLAP = 0.5  # share of the source that must lie near the reference at the answer


@dataclass(frozen=True)
class Registered:
    """The answer for two scans."""

    T_reference_source: np.ndarray  # (4, 4)
    iterations: int
    rmse: float  # [m] of the links that were kept
    overlap: float  # share of the source's points that lie near the reference


def register_scans(
    reference: np.ndarray,
    source: np.ndarray,
    T_initial: np.ndarray,
    where: str,
    start_option: str = "`guess` of the folder",
) -> Registered:
    """`Registered` of two raw scans (n, 3), (m, 3) [m], each in its scanner's frame.

    T_initial: (4, 4), T_reference_source at the start; where: what errors call the pair;
    start_option: what they say sets the start. Raises DataError if ICP does not settle, or the
    scans hardly overlap at its answer.
    """
    voxel = _voxel(reference)
    reference, source = (_thinned(_beyond_robot(points), voxel) for points in (reference, source))
    fewest = min(len(reference), len(source))
    if fewest < NEIGHBOURS * MATCHES:
        raise DataError(
            f"{where}: {fewest} points are left of a scan in cubes of {voxel:.3g} m, expected"
            f" {NEIGHBOURS * MATCHES} or more to register it.",
            "check that the scans are in metres and in the scanner's own frame.",
        )
    target = icp.Reference(reference, normal_neighbours=NEIGHBOURS)
    rows = len(OFFSETS) * [np.arange(len(source))]
    start = se3.exp(se3.log(T_initial))  # without the rounding of a file
    T = start @ se3.exp(OFFSETS * [1, 1, 1, voxel, voxel, voxel])
    iterations = np.zeros(len(T), dtype=int)
    for distance in DISTANCES:
        chain = _chain(distance and distance * voxel, is_last=distance == DISTANCES[-1])
        result = icp.register(target, source, rows, T, chain)
        T = result.T_reference_source
        iterations += result.iterations
        log.info("%s: links up to %s voxels: %s", where, distance or "any", result.status)
    settled = np.flatnonzero(result.status == "ok")
    if not len(settled):
        ended = f"ICP ended with {result.status[0]} from every start"
        raise _no_answer(where, ended, start_option)
    nearness = [_nearness(reference, source, T[run], voxel) for run in settled]
    best = settled[int(np.argmax(nearness))]
    log.info("%s: near to each other %s, the best is %d", where, np.round(nearness, 3), best)
    near = nearest_distances(reference, source, T[best]) <= max(OVERLAP_DISTANCE, 2 * voxel)
    found = Registered(T[best], int(iterations[best]), float(result.rmse[best]), float(near.mean()))
    log.info("%s: overlap %.3f, rmse %.4f m", where, found.overlap, found.rmse)
    if found.overlap < MINIMUM_OVERLAP:
        raise _no_answer(
            where,
            f"at ICP's answer {100 * found.overlap:.0f} % of the source points lie near the"
            f" reference, expected {100 * MINIMUM_OVERLAP:.0f} % or more",
            start_option,
        )
    return found


def _nearness(reference, source, T_reference_source, distance):
    """Share of the points of both clouds that lie within a distance [m] of the other cloud."""
    there = nearest_distances(reference, source, T_reference_source) <= distance
    back = nearest_distances(source, reference, se3.inverse(T_reference_source)) <= distance
    return (there.mean() + back.mean()) / 2


def _no_answer(where, problem, start_option):
    return DataError(
        f"{where}: did not register: {problem}.",
        f"check that the scans are in metres and overlap; let ICP start nearer to the answer"
        f" ({start_option}), or give the true pose.",
    )


def _chain(maximum_distance, is_last):
    stopping = icp.Stopping(ITERATIONS, STEP, STEP) if is_last else icp.Stopping(ITERATIONS)
    return icp.Chain(
        matches=MATCHES,
        outlier_filter=icp.Trimmed(KEPT_LINKS),
        maximum_distance=maximum_distance,
        stopping=stopping,
    )


def _voxel(points):
    """Edge [m] of the cubes that a scan is thinned to a point of."""
    median = float(np.median(np.linalg.norm(points, axis=1)))
    return min(max(median / VOXELS, SMALLEST_VOXEL), LARGEST_VOXEL)


def _beyond_robot(points):
    """The points beyond the robot; all where these are too few, in a scan of something near."""
    beyond = points[icp.minimum_range(points, ROBOT)]
    return beyond if len(beyond) >= MINIMUM_POINTS else points


def _thinned(points, voxel):
    """The first point in each cube."""
    cubes = np.floor(points / voxel).astype(np.int64)
    _, first = np.unique(cubes, axis=0, return_index=True)
    return points[np.sort(first)]


def chained(T_between: Iterable[np.ndarray]) -> np.ndarray:
    """Poses T_global_scan (n + 1, 4, 4) of n transforms between consecutive scans.

    The first scan's frame is the global one.
    """
    poses = [np.eye(4)]
    for T in T_between:
        poses.append(poses[-1] @ T)
    return np.stack(poses)


def guesses(transforms: np.ndarray, scans: int, where: str) -> np.ndarray:
    """Where ICP starts for each two consecutive scans, (scans - 1, 4, 4).

    transforms: (1, 4, 4) for all, or one of each. Raises DataError for another number.
    """
    if len(transforms) not in (1, scans - 1):
        raise DataError(
            f"{where}: {len(transforms)} transforms, expected 1 or {scans - 1}, one for each two"
            f" consecutive scans of `scans: {scans}`.",
            "each is T_reference_source, of 12 or 16 numbers in a line.",
        )
    return np.broadcast_to(transforms, (scans - 1, 4, 4))
