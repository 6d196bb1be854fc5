"""Say what is played of pairs of a sequence: the levels that were diagnosed, and where."""

from functools import partial

import pandas as pd

from icpshap import tables
from icpshap.data.pair import Pairs
from icpshap.diagnosis import here
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams
from icpshap.jobs import plans
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def find_instances(paths, output, plan):
    plans.check(paths.diagnosis, plan["diagnosis"])
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)
    row_of = partial(
        here.row_of,
        told={name: level for name, (level,) in plan["levels"].items()},
        load=pairs.read,
        estimator=Estimator.decided(plan["estimator"]),
        streams=lambda pair: Streams(plan["seed"], plan["sequence"], *pair),
        minimum_overlap=plan["minimum_overlap"],
    )
    diagnosed = list(tables.read(paths.diagnosis, "diagnosis").itertuples())
    found = pd.DataFrame(in_turn(diagnosed, row_of, "pairs"))
    data = pairs.data(plan["among"])
    tables.write(output, found, "instances", plan, plan["causes"], data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        find_instances(snakemake.input, snakemake.output[0], snakemake.params.plan)
