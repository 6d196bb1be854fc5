"""Mark the source points of a pair that overlap with the reference at the true pose."""

import pandas as pd

from icpshap import tables
from icpshap.data.pair import Pair, relative_pose
from icpshap.jobs.job import job


def measure_overlap(paths, output, indices, plan):
    reference, source = tables.read_points(paths.reference), tables.read_points(paths.source)
    T_reference_source = relative_pose(tables.read_poses(paths.poses), *indices)
    pair = Pair.measured(reference, source, T_reference_source, plan["distance"])
    frame = pd.DataFrame({"overlapping": pair.overlapping})
    tables.write(output, frame, "overlap", plan, overlap=pair.overlap)


if __name__ == "__main__":
    with job(snakemake, __file__):
        wildcards = snakemake.wildcards
        indices = (int(wildcards.reference), int(wildcards.source))
        measure_overlap(snakemake.input, snakemake.output[0], indices, snakemake.params.plan)
