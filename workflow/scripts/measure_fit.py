"""Measure how the settings of an experiment fit the scans of a sequence, and say what does not."""

import pandas as pd

from icpshap import tables
from icpshap.data.pair import read_pair
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams
from icpshap.fit import checks
from icpshap.fit.measure import measure
from icpshap.jobs import digests
from icpshap.jobs.job import job


def measure_fit(paths, output, plan, scans, title, terminal):
    estimator = Estimator.decided(plan["estimator"])
    points = dict(zip(scans, paths.scans, strict=True))
    rows = []
    for indices, overlap in zip(plan["pairs"], paths.overlaps, strict=True):
        reference, source = indices
        pair = read_pair(points[reference], points[source], paths.poses, overlap, indices)
        streams = Streams(plan["seed"], plan["sequence"], *indices)
        named = {"sequence": plan["sequence"], "reference": reference, "source": source}
        rows.append({**named, **measure(pair, estimator, plan["levels"], streams)})
    numbers = pd.DataFrame(rows)
    print(*checks.lines(checks.table(numbers), title), sep="\n", file=terminal)
    data = digests.data_digests(*paths.scans)
    tables.write(output, numbers, "fit_numbers", plan, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        # By its key, since another title would measure again, and explain what follows.
        title = f"{snakemake.wildcards.experiment}, {snakemake.wildcards.sequence}"
        found = (snakemake.params.plan, snakemake.params.scans, title)
        measure_fit(snakemake.input, snakemake.output[0], *found, terminal)
