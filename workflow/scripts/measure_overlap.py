"""Mark the source points of a pair that overlap with the reference at the true pose."""

import pandas as pd

from icpshap import tables
from icpshap.data.pair import relative_pose
from icpshap.estimators import perturb as perturbation
from icpshap.jobs.logs import job_log


def measure_overlap(reference, source, poses, output, indices, distance):
    reference, source = tables.read_points(reference), tables.read_points(source)
    T_reference_source = relative_pose(tables.read_poses(poses), *indices)
    distances = perturbation.nearest_distances(reference, source, T_reference_source)
    overlapping = distances <= distance
    ratio = overlapping.sum() / len(reference)
    tables.write(output, pd.DataFrame({"overlapping": overlapping}), "overlap", {"overlap": ratio})


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
