"""Numbers of a pair of scans that say whether an estimator's options fit them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy.spatial import KDTree

from icpshap import se3
from icpshap.errors import PerturbationError
from icpshap.estimators import perturb
from icpshap.geometry import nearest_distances, nearest_to_cell_centres, scatter
from icpshap.plan import Setting

if TYPE_CHECKING:
    from icpshap.data.pair import Pair
    from icpshap.estimators import Estimator


NEIGHBOURHOODS = 4000  # of the reference at most, every k-th
OVERLAPPING = 20_000  # source points at most whose distance to the reference is measured
COLLINEAR = 0.1  # second axis of a neighbourhood against its first, below which it is a line
WITHIN = 5  # times the overlap distance: source points that see what the reference sees
NO_RETURN = 1e-3  # m from the scanner
RINGED = 0.2  # share of neighbourhoods on one ring from which another chain is looked for
# Voxel side [m] and neighbours that are tried then, those that change least first.
TRIED = ((None, 20), (0.25, 20), (0.25, 30), (0.5, 20), (0.5, 30))


def measure(
    pair: Pair, estimator: Estimator, levels: Mapping[str, float], streams: perturb.Streams
) -> dict[str, Any]:
    """The numbers of a pair by column of the table `fit_numbers`.

    pair: data.pair.Pair; estimator: estimators.Estimator; levels: the largest of each cause, by
    name; streams: perturb.Streams of the pair. NaN where a number has no meaning for the estimator.
    """
    off = {cause.name: cause.off for cause in estimator.causes.values()}
    clean = Setting.at({name: off[name] for name in levels})
    minimum_range = estimator.perturbing.minimum_range
    neighbourhood = estimator.kind.neighbourhood
    draws = perturb.Draws(pair, estimator, None, streams)
    reference = draws.seen_reference(clean, pair.reference, 0)
    of_normals = normals(reference, neighbourhood)
    in_range = [scan[draws.in_range(scan)] for scan in (pair.reference, pair.source)]
    at_truth = pair.for_chain(minimum_range).at_truth
    return {
        **_options(estimator),
        **of_normals,
        **without_rings(in_range[0], neighbourhood, of_normals["ring_share"]),
        "largest_noise": levels.get("sensor_noise", np.nan) if _in_metres(estimator) else np.nan,
        "source_points": points_of_a_run(pair, Setting.at(levels), estimator, streams),
        "reference_points": len(reference),
        **overlap(pair),
        "duplicate_share": duplicate_share(*in_range),
        **ranges(pair, minimum_range),
        "median_distance": at_truth.distance,
        "better_pose": at_truth.better,
    }


def points_of_a_run(
    pair: Pair, setting: Setting, estimator: Estimator, streams: perturb.Streams
) -> float:
    """Source points of a run; NaN where the setting cannot be applied to the pair."""
    try:
        return perturb.points_of_a_run(pair, setting, estimator, streams)
    except PerturbationError:
        return np.nan


def _options(estimator):
    """Options that the checks hold numbers against."""
    perturbing = estimator.perturbing
    side = perturbing.voxel_size
    return {
        "minimum_range": perturbing.minimum_range,
        "voxel_size": np.nan if side is None else side,
        "subsampling_probability": perturbing.subsampling_probability,
        "stop_rotation": getattr(estimator.kind, "stop_rotation", np.nan),
    }


def _in_metres(estimator):
    noise = estimator.causes.get("sensor_noise")
    return noise is not None and noise.sensor == "none"


def normals(points: np.ndarray, neighbourhood: tuple[int, float] | None) -> dict[str, float]:
    """Radius [m] of the neighbourhoods that give normals, and how many of them lie on a line.

    points (n, 3): in the frame of their scanner; neighbourhood: number of neighbours and radius
    [m], or None without normals, of which all is NaN. line_share: of those on a line in space;
    ring_share: on one ring of the scanner, which is a line as the scanner sees it, whatever the
    noise along its beams, or in space.
    """
    if neighbourhood is None or len(points) < neighbourhood[0]:
        return dict.fromkeys(("neighbours", "normal_radius", "line_share", "ring_share"), np.nan)
    neighbours, radius = neighbourhood
    tree = KDTree(points)
    centres = points[:: -(-len(points) // NEIGHBOURHOODS)]
    distances, nearest = tree.query(centres, neighbours)
    bearings = points / np.maximum(np.linalg.norm(points, axis=1, keepdims=True), 1e-12)
    reach = distances[:, -1].copy()
    on_line, on_ring = (_are_lines(of[nearest]) for of in (points, bearings))
    for place in np.flatnonzero(reach < radius):
        rows = tree.query_ball_point(centres[place], radius)
        reach[place] = radius if len(rows) > neighbours else reach[place]
        on_line[place], on_ring[place] = (
            _are_lines(of[rows][None])[0] for of in (points, bearings)
        )
    return {
        "neighbours": float(neighbours),
        "normal_radius": float(np.median(reach)),
        "line_share": float(on_line.mean()),
        "ring_share": float((on_line | on_ring).mean()),
    }


def without_rings(
    points: np.ndarray, neighbourhood: tuple[int, float] | None, ring_share: float
) -> dict[str, float]:
    """The voxel side [m] and neighbours with which few neighbourhoods lie on one ring.

    mending_voxel is NaN for none, mending_neighbours where there is nothing to mend or nothing that
    was tried mends it. points (n, 3): of the reference beyond the minimum range.
    """
    found = {"mending_voxel": np.nan, "mending_neighbours": np.nan}
    if neighbourhood is None or not ring_share > RINGED:
        return found
    for side, neighbours in TRIED:
        kept = points if side is None else points[nearest_to_cell_centres(points, side)]
        tried = normals(kept, (neighbours, neighbourhood[1]))
        if tried["ring_share"] <= RINGED:
            side = np.nan if side is None else side
            return {"mending_voxel": side, "mending_neighbours": float(neighbours)}
    return found


def _are_lines(clouds):
    """Which of clouds (m, k, 3) spread along one axis alone."""
    variances = np.linalg.eigvalsh(scatter(clouds))
    return variances[:, 1] < COLLINEAR**2 * variances[:, 2]


def overlap(pair: Pair) -> dict[str, float]:
    """Overlap ratio, and how far the reference is where the source sees the same.

    matched_distance [m]: within which three quarters of the source points have a reference point,
    of those that have one within 5 times the overlap distance; NaN of none.
    """
    sample = pair.source[:: -(-len(pair.source) // OVERLAPPING)]
    distances = nearest_distances(pair.reference, sample, pair.T_reference_source)
    same = distances[distances <= WITHIN * pair.overlap_distance]
    return {
        "overlap": pair.overlap,
        "overlap_distance": pair.overlap_distance,
        "matched_distance": float(np.quantile(same, 0.75)) if len(same) else np.nan,
    }


def duplicate_share(*clouds: np.ndarray) -> float:
    """Share of the points of clouds (n, 3) that lie where an earlier one of their cloud does."""
    again = sum(int(pd.DataFrame(cloud).duplicated().sum()) for cloud in clouds)
    return again / sum(map(len, clouds))


def ranges(pair: Pair, minimum_range: float) -> dict[str, float]:
    """Ranges [m] of both scans; points at the origin itself, which are no returns, do not count."""
    both = np.linalg.norm(np.concatenate([pair.reference, pair.source]), axis=1)
    returns = both[both > NO_RETURN]
    return {
        "nearest_return": float(returns.min()) if len(returns) else np.nan,
        "typical_range": float(np.median(returns)) if len(returns) else np.nan,
        "removed_share": float(np.mean(both <= minimum_range)),
        "motion": float(np.linalg.norm(se3.log(pair.T_reference_source)[3:])),
    }
