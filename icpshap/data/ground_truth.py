"""Whether the true motion between two scans, as their poses have it, can be right."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from icpshap import se3

OVERLAP_DISTANCE = 0.2  # m; the paper's distance between overlapping points
SANITY_POINTS = 5000  # of the source at most, every k-th
ROUND_OFF = 1e-6  # m; of nearer clouds none is the better one
ROBOT = 1.0  # m; what is nearer moves along with the scanner, where no chain says otherwise
NO_MOTION, INVERSE, TRANSPOSED = (
    "with no motion at all",
    "with the inverse motion",
    "with the transposed rotation",
)
FRAMES = (
    "a pose maps the source's points into the reference's frame, one of a drive from scanner to "
    "global frame, and line k belongs to scan k"
)
# What may be wrong with a pose, by the motion at which the clouds lie nearer to each other.
MEANT = {
    NO_MOTION: FRAMES,
    INVERSE: FRAMES,
    TRANSPOSED: "matrices are row-major, [R t; 0 1]",
}


class Fit(NamedTuple):
    """How near two clouds lie at their true pose.

    distance [m]: median, from source points to their nearest reference point; better: the motion at
    which they lie nearer to each other, one of MEANT, "" for none; better_distance [m]: there.
    """

    distance: float
    better: str
    better_distance: float


def measured(
    reference: np.ndarray, source: np.ndarray, T_reference_source: np.ndarray, minimum_range: float
) -> Fit:
    """The `Fit` of two clouds (n, 3), each in its own scanner frame.

    Points within ``minimum_range`` [m] (the robot itself, which moves along) are left out.
    """
    reference = reference[np.linalg.norm(reference, axis=1) > minimum_range]
    source = source[np.linalg.norm(source, axis=1) > minimum_range]
    tree = cKDTree(reference)
    sample = source[:: -(-len(source) // SANITY_POINTS)]

    def median_distance(T):
        return float(np.median(tree.query(se3.transform(T, sample))[0]))

    distance = median_distance(T_reference_source)
    transposed = T_reference_source.copy()
    transposed[:3, :3] = T_reference_source[:3, :3].T
    others = {
        NO_MOTION: median_distance(np.eye(4)),
        INVERSE: median_distance(se3.inverse(T_reference_source)),
        TRANSPOSED: median_distance(transposed),
    }
    better = min(others, key=others.__getitem__)
    if distance > ROUND_OFF and others[better] < 0.9 * distance:
        return Fit(distance, better, others[better])
    return Fit(distance, "", np.nan)


def ground_truth_distance(
    reference: np.ndarray, source: np.ndarray, T_reference_source: np.ndarray, minimum_range: float
) -> tuple[float, str]:
    """Median distance [m] from source points (m, 3) to the reference (n, 3), and `warning`.

    Arguments as of `measured`.
    """
    fit = measured(reference, source, T_reference_source, minimum_range)
    return fit.distance, warning(fit)


def warning(fit: Fit) -> str:
    """What is wrong with the true pose by a `Fit`; "" if all is well.

    The median distance is above 0.2 m (less than half of the source overlaps), or the clouds fit
    better with no motion, with the inverse motion or with the transposed rotation (poses of the
    wrong convention).
    """
    distance, better, other = fit
    if better:
        return (
            f"the ground truth looks wrong: {better} the clouds are nearer to each other"
            f" (median {other:.3f} m) than at it ({distance:.3f} m). Hint: {MEANT[better]}."
        )
    if distance > OVERLAP_DISTANCE:
        return (
            f"the ground truth looks wrong, or the scans hardly overlap: at it, half of the source"
            f" points are farther than {distance:.3f} m from the reference (usual: below"
            f" {OVERLAP_DISTANCE} m). Hint: check units (metres) and the order of scans and poses."
        )
    return ""
