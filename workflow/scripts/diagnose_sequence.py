"""Diagnose the pairs of a sequence, each beside the others, without any ICP."""

from functools import partial

from icpshap import tables
from icpshap.data.pair import Pairs
from icpshap.diagnosis.table import table
from icpshap.estimators.perturb import Streams
from icpshap.jobs.job import job


def diagnose_sequence(paths, output, plan):
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)

    def load(indices):
        return pairs.read(indices).for_chain(plan["minimum_range"])

    loads = [partial(load, indices) for indices in plan["pairs"]]
    streams = [Streams(plan["seed"], plan["sequence"], *indices) for indices in plan["pairs"]]
    data = pairs.data(plan["pairs"])
    tables.write(output, table(loads, streams), "diagnosis", plan, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        diagnose_sequence(snakemake.input, snakemake.output[0], snakemake.params.plan)
