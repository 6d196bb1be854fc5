"""Describe a pair, and stop before it is registered if it cannot be perturbed as asked."""

import pandas as pd

from icpshap import tables
from icpshap.causes import CAUSES
from icpshap.data.pair import describe_pair, read_pair
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams, require_points
from icpshap.jobs import digests
from icpshap.jobs.job import job
from icpshap.plan import Setting


def check_pair(paths, output, plan, terminal):
    indices = tuple(plan["pair"])
    pair = read_pair(paths.reference, paths.source, paths.poses, paths.overlap, indices)
    row = describe_pair(
        pair,
        plan["sequence"],
        indices,
        levels=[(CAUSES[name](**options), level) for name, options, level in plan["levels"]],
        minimum_overlap=plan["minimum_overlap"],
        minimum_range=plan["minimum_range"],
        truth=(truth := tables.read_about(paths.poses).get("truth", "")),
    )
    if "estimator" in plan and row["registered"]:
        largest = Setting.at({name: level for name, _, level in plan["levels"]})
        streams = Streams(plan["seed"], plan["sequence"], *indices)
        require_points(pair, largest, Estimator.decided(plan["estimator"]), streams)
    for remark in filter(None, (row["reason"], row["warning"])):
        if remark == truth:  # said once, of the whole sequence
            continue
        reference, source = indices
        print(f"{plan['sequence']} {reference}-{source}: {remark}", file=terminal)
    data = digests.data_digests(paths.reference, paths.source)
    tables.write(output, pd.DataFrame([row]), "pairs", plan, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        check_pair(snakemake.input, snakemake.output[0], snakemake.params.plan, terminal)
