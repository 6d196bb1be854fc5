"""Diagnose the pairs of a sequence, each beside the others, without any ICP."""

from functools import partial

from icpshap import tables
from icpshap.data.pair import read_pair
from icpshap.diagnosis.table import table
from icpshap.estimators.perturb import Streams
from icpshap.jobs import digests
from icpshap.jobs.job import job


def diagnose_sequence(paths, output, plan, scans):
    points = dict(zip(scans, paths.scans, strict=True))

    def load(indices, overlap):
        reference, source = indices
        pair = read_pair(points[reference], points[source], paths.poses, overlap, indices)
        return pair.for_chain(plan["minimum_range"])

    loads = [partial(load, *of) for of in zip(plan["pairs"], paths.overlaps, strict=True)]
    streams = [Streams(plan["seed"], plan["sequence"], *indices) for indices in plan["pairs"]]
    data = digests.data_digests(*paths.scans)
    tables.write(output, table(loads, streams), "diagnosis", plan, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        found = (snakemake.params.plan, snakemake.params.scans)
        diagnose_sequence(snakemake.input, snakemake.output[0], *found)
