"""Mark the source points of a pair that overlap with the reference at the true pose."""

import logging

import numpy as np
import pandas as pd

from icpshap import perturbation, se3, tables
from icpshap.logs import job_log


def measure_overlap(reference, source, poses, output, pair, distance):
    T_global_scan = tables.read_poses(poses)
    T_reference_source = se3.inverse(T_global_scan[pair[0]]) @ T_global_scan[pair[1]]
    reference, source = tables.read_points(reference), tables.read_points(source)
    distances = perturbation.nearest_distances(reference, source, T_reference_source)
    overlapping = distances <= distance
    summary = {
        "overlap": overlapping.sum() / len(reference),
        "median_distance": np.median(distances[overlapping]) if overlapping.any() else None,
        "reference_points": len(reference),
    }
    logging.info("scans %d and %d: %s", *pair, summary)
    tables.write(output, pd.DataFrame({"overlapping": overlapping}), "overlap", summary)


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        measure_overlap(
            snakemake.input.reference,
            snakemake.input.source,
            snakemake.input.poses,
            snakemake.output[0],
            (int(snakemake.wildcards.reference), int(snakemake.wildcards.source)),
            snakemake.params.distance,
        )
