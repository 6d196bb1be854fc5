"""Say what is played of each pair of a sequence: the levels that were diagnosed, and where."""

from icpshap import tables
from icpshap.data.pair import read_pair
from icpshap.diagnosis import here
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams
from icpshap.jobs import digests, plans
from icpshap.jobs.job import job


def find_instances(paths, output, plan, scans, overlaps):
    plans.check(paths.diagnosis, plan["diagnosis"])
    points = dict(zip(scans, paths.scans, strict=True))
    overlaps = dict(zip(overlaps, paths.overlaps, strict=True))

    def load(pair):
        return read_pair(*(points[index] for index in pair), paths.poses, overlaps[pair], pair)

    found = here.table(
        tables.read(paths.diagnosis, "diagnosis"),
        {name: level for name, (level,) in plan["levels"].items()},
        load,
        Estimator.decided(plan["estimator"]),
        lambda pair: Streams(plan["seed"], plan["sequence"], *pair),
        plan["minimum_overlap"],
    )
    causes = [*plan["levels"], *plan["measured"]]
    data = digests.data_digests(*paths.scans)
    tables.write(output, found, "instances", plan, causes, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        found = (params.plan, params.scans, params.overlaps)
        find_instances(snakemake.input, snakemake.output[0], *found)
