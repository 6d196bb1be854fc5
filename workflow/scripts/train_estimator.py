"""Descriptors of a sequence's perturbed pairs, and the covariances of their runs."""

import pandas as pd

from icpshap import plan, tables
from icpshap.data.pair import Pairs
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams
from icpshap.explanation import training
from icpshap.explanation.method import Method
from icpshap.explanation.scan_pair import ScanPair
from icpshap.jobs import plans
from icpshap.jobs.job import job


def train_estimator(paths, output, planned, jobs):
    for files in filter(None, (paths.runs, paths.estimates)):
        plans.check_estimates(files, jobs, planned, paths.pairs)
    runs, estimates = (tables.ByPair(paths[name], name) for name in ("runs", "estimates"))
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)
    rows = tables.read_all(paths.pairs, "pairs")
    causes = list(planned["levels"])
    settings = plan.settings(planned["levels"], planned["replicates"])
    estimator = Estimator.decided(planned["estimator"])
    method = Method(**planned["method"], seed=planned["seed"])
    found = [tables.empty("descriptors", causes)]
    for row in rows[rows["registered"]].itertuples():
        indices = (row.reference, row.source)
        streams = Streams(planned["seed"], planned["sequence"], *indices)
        returned = (runs.get(indices), estimates.get(indices))
        of_pair = (pairs.read(indices), settings, estimator, streams, *returned)
        found.append(training.examples(*of_pair, method, ScanPair.of(row)))
    frame = pd.concat([part for part in found if len(part)] or found[:1])
    data = pairs.data(rows[["reference", "source"]].itertuples(index=False, name=None))
    tables.write(output, frame, "descriptors", planned, causes, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        train_estimator(snakemake.input, snakemake.output[0], params.plan, params.jobs)
