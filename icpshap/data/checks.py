"""What can be wrong with a pair of scans, said before anything is registered."""

import logging

from icpshap.data import scans as dataset
from icpshap.estimators.perturb import PerturbationError


def describe_pair(pair, sequence, indices, *, largest_reduction, minimum_overlap, minimum_range):
    """A row of the pairs table, by column.

    pair: perturbation.Pair; largest_reduction: largest lambda that will be asked for;
    minimum_overlap: a pair whose overlap ratio is not above it is not registered; minimum_range:
    the chain's [m]. Raises dataset.DataError for a scan with too few points beyond the range,
    PerturbationError for a lambda that the overlap does not allow.
    """
    reference, source = indices
    for index, points in ((reference, pair.reference), (source, pair.source)):
        dataset.check_scan(points, minimum_range, f"{sequence}, scan {index}")
    registered = pair.overlap > minimum_overlap
    if registered and largest_reduction > pair.overlap:
        raise PerturbationError(
            f"{sequence}, scans {reference} and {source}: partial_overlap {largest_reduction} is "
            f"larger than their overlap ratio {pair.overlap:.4f}.\n"
            "Hint: choose smaller levels of partial_overlap, or other pairs."
        )
    distance, warning = dataset.ground_truth_distance(
        pair.reference, pair.source, pair.T_reference_source, minimum_range
    )
    reason = (
        "" if registered else f"overlap ratio {pair.overlap:.4f} is not above {minimum_overlap}"
    )
    logging.info("overlap %.4f, median distance at the true pose %.4f m", pair.overlap, distance)
    for remark in filter(None, (reason, warning)):
        logging.warning(remark)
    return {
        "sequence": sequence,
        "reference": reference,
        "source": source,
        "reference_points": len(pair.reference),
        "source_points": len(pair.source),
        "overlap": pair.overlap,
        "median_distance": distance,
        "registered": registered,
        "reason": reason,
        "warning": warning,
    }
