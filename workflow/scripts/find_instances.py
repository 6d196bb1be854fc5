"""Say what is played of each pair of a sequence: the levels that were diagnosed, and where."""

from icpshap import tables
from icpshap.data.pair import Pairs
from icpshap.diagnosis import here
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams
from icpshap.jobs import plans
from icpshap.jobs.job import job


def find_instances(paths, output, plan):
    plans.check(paths.diagnosis, plan["diagnosis"])
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)
    diagnosis = tables.read(paths.diagnosis, "diagnosis")
    found = here.table(
        diagnosis,
        {name: level for name, (level,) in plan["levels"].items()},
        pairs.read,
        Estimator.decided(plan["estimator"]),
        lambda pair: Streams(plan["seed"], plan["sequence"], *pair),
        plan["minimum_overlap"],
    )
    causes = [*plan["levels"], *plan["measured"]]
    data = pairs.data(list(zip(diagnosis.reference, diagnosis.source, strict=True)))
    tables.write(output, found, "instances", plan, causes, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        find_instances(snakemake.input, snakemake.output[0], snakemake.params.plan)
