"""Diagnose pairs of a sequence, each beside those around it, without any ICP."""

from functools import partial

import pandas as pd

from icpshap import tables
from icpshap.data.pair import Pairs
from icpshap.diagnosis.diagnose import Known
from icpshap.diagnosis.table import row_of
from icpshap.estimators.perturb import Streams
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def diagnose_pairs(paths, output, plan):
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)

    def load(indices):
        return pairs.read(indices).for_chain(plan["minimum_range"])

    known = [
        Known(partial(load, indices), Streams(plan["seed"], plan["sequence"], *indices))
        for indices in plan["among"]
    ]
    places = [plan["among"].index(indices) for indices in plan["pairs"]]
    found = pd.DataFrame(in_turn(places, partial(row_of, known), "pairs"))
    tables.write(output, found, "diagnosis", plan, data=pairs.data(plan["among"]))


if __name__ == "__main__":
    with job(snakemake, __file__):
        diagnose_pairs(snakemake.input, snakemake.output[0], snakemake.params.plan)
