"""Pairs of scans: read from their tables, and checked before anything is registered."""

import logging

import pandas as pd

from icpshap import dataset, perturbation, se3, tables


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


def list_pairs(sequence, clouds, T_global_scan, overlaps, largest_reduction, minimum, range_):
    """The pairs table of a sequence.

    clouds: scan index to points (n, 3) [m]; overlaps: (reference, source) to overlap ratio;
    largest_reduction: largest lambda that will be asked for; minimum: pairs whose overlap is not
    above it are not registered; range_: the chain's minimum range [m].
    Raises dataset.DataError for a scan with too few points beyond the range, PerturbationError for
    a lambda that a pair's overlap does not allow.
    """
    for index, points in clouds.items():
        dataset.check_scan(points, range_, f"{sequence}, scan {index}")
    rows = []
    for (i, j), overlap in overlaps.items():
        registered = overlap > minimum
        if registered and largest_reduction > overlap:
            raise perturbation.PerturbationError(
                f"{sequence}, scans {i} and {j}: partial_overlap {largest_reduction} is larger "
                f"than their overlap ratio {overlap:.4f}.\n"
                "Hint: choose smaller levels of partial_overlap, or other pairs."
            )
        distance, warning = dataset.ground_truth_distance(
            clouds[i], clouds[j], relative_pose(T_global_scan, i, j), range_
        )
        reason = "" if registered else f"overlap ratio {overlap:.4f} is not above {minimum}"
        rows.append(
            {
                "sequence": sequence,
                "reference": i,
                "source": j,
                "reference_points": len(clouds[i]),
                "source_points": len(clouds[j]),
                "overlap": overlap,
                "median_distance": distance,
                "registered": registered,
                "reason": reason,
                "warning": warning,
            }
        )
        logging.info(
            "scans %d and %d: overlap %.4f, median distance %.4f m", i, j, overlap, distance
        )
        for remark in filter(None, (reason, warning)):
            logging.warning("scans %d and %d: %s", i, j, remark)
    return pd.DataFrame(rows)
