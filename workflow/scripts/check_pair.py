"""Describe a pair, and stop before it is registered if it cannot be perturbed as asked."""

import pandas as pd

from icpshap import tables
from icpshap.data import checks
from icpshap.data.pair import read_pair
from icpshap.jobs.logs import job_log


def check_pair(paths, output, sequence, indices, **limits):
    pair = read_pair(paths.reference, paths.source, paths.poses, paths.overlap, indices)
    row = checks.describe_pair(pair, sequence, indices, **limits)
    tables.write(output, pd.DataFrame([row]), "pairs")


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        wildcards, params = snakemake.wildcards, snakemake.params
        check_pair(
            snakemake.input,
            snakemake.output[0],
            wildcards.sequence,
            (int(wildcards.reference), int(wildcards.source)),
            largest_reduction=params.largest_reduction,
            minimum_overlap=params.minimum_overlap,
            minimum_range=params.minimum_range,
        )
