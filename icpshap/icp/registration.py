"""Register many runs against one reference: match, filter, step, until every run has stopped."""

from dataclasses import dataclass

import numpy as np

from icpshap.icp.matching import iterate
from icpshap.icp.reference import checked_points

STATUS = ("ok", "max_iterations", "too_few_links", "degenerate")


@dataclass(frozen=True)
class Registrations:
    """Results of R runs.

    A run that fails ("too_few_links", "degenerate") keeps the pose it had reached: the product of
    the initial pose and the steps taken until then, `iterations` of them.
    """

    T_reference_source: np.ndarray  # (R, 4, 4)
    iterations: np.ndarray  # (R,) steps taken
    status: np.ndarray  # (R,) one of STATUS
    rmse: np.ndarray  # (R,) [m] of the kept links in the last matching, under the chain's metric
    inlier_ratio: np.ndarray  # (R,) kept links of the last matching / (matches * source points)


def register(reference, source, rows, T_initial, chain):
    """ICP of R runs: source points (m, 3) [m], source frame, onto a Reference.

    rows: R ascending integer arrays, the source rows each run uses.
    T_initial: (R, 4, 4), T_reference_source at the start.
    Returns Registrations. Raises ValueError for points, poses or rows that cannot be used.
    """
    source = checked_points(source, "source cloud")
    minimiser, stopping = chain.error_minimiser, chain.stopping
    R = len(rows)
    surface = np.zeros((len(reference), 8))
    surface[:, :3] = reference.tree.points[:, :3]
    if minimiser.needs_normals:
        surface[:, 3:6] = reference.normals
    T_initial = np.array(T_initial, dtype=float)
    T_start = T_initial.copy()
    T_start[:, :3, 3] -= reference.mean
    start = np.zeros(R + 1, np.int64)
    np.cumsum([len(r) for r in rows], out=start[1:])
    flat = np.concatenate(rows).astype(np.int32)
    T = np.tile(np.eye(4), (R, 1, 1))
    active = np.arange(R)
    gram = np.zeros((R, 7, 7))
    kept = np.zeros(R, np.int64)
    links = np.zeros(R, np.int64)
    angles = np.full((R, 3), np.inf)
    lengths = np.full((R, 3), np.inf)
    iterations = np.zeros(R, np.int64)
    status = np.full(R, "max_iterations", dtype="<U14")
    limit = np.inf if chain.maximum_distance is None else chain.maximum_distance**2
    for iteration in range(stopping.maximum_iterations):
        iterate(
            reference.tree,
            surface,
            source,
            flat,
            start,
            active,
            T @ T_start,
            chain.matches,
            limit,
            chain.outlier_filter.ratio,
            minimiser.metric,
            gram,
            kept,
            links,
        )
        enough = kept[active] >= minimiser.minimum_links
        status[active[~enough]] = "too_few_links"
        active = active[enough]
        step, determined = minimiser.step(gram[active])
        status[active[~determined]] = "degenerate"
        active, step = active[determined], step[determined]
        T_next = step @ T[active]
        moved = np.linalg.norm(T_next[:, :3, 3] - T[active, :3, 3], axis=1)
        cos = (np.trace(step[:, :3, :3], axis1=1, axis2=2) - 1) / 2
        skew = step[:, [2, 0, 1], [1, 2, 0]] - step[:, [1, 2, 0], [2, 0, 1]]
        angles[active, iteration % 3] = np.arctan2(np.linalg.norm(skew, axis=1) / 2, cos)
        lengths[active, iteration % 3] = moved
        T[active] = T_next
        iterations[active] = iteration + 1
        stop = (angles[active].mean(1) < stopping.rotation) & (
            lengths[active].mean(1) < stopping.translation
        )
        status[active[stop]] = "ok"
        active = active[~stop]
        if not len(active):
            break
    T_result = T @ T_start
    T_result[:, :3, 3] += reference.mean
    n = chain.matches * np.diff(start)
    with np.errstate(invalid="ignore", divide="ignore"):
        rmse = np.sqrt(minimiser.squared_error(gram) / kept)
        ratio = np.where(n > 0, kept / n, 0.0)
    return Registrations(T_result, iterations, status, rmse, ratio)
