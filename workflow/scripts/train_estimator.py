"""Descriptors of a sequence's perturbed pairs, and the covariances of their runs."""

import pandas as pd

from icpshap import plan, tables
from icpshap.data.pair import read_pair
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams
from icpshap.explanation import training
from icpshap.explanation.method import Method
from icpshap.explanation.scan_pair import ScanPair
from icpshap.jobs import digests, plans
from icpshap.jobs.job import job


def train_estimator(paths, output, planned, jobs, scans):
    for files in filter(None, (paths.runs, paths.estimates)):
        plans.check_estimates(files, jobs, planned, paths.pairs)
    runs, estimates = (tables.read_by_pair(paths[name], name) for name in ("runs", "estimates"))
    points = dict(zip(scans, paths.scans, strict=True))
    causes = list(planned["levels"])
    settings = plan.settings(planned["levels"], planned["replicates"])
    estimator = Estimator.decided(planned["estimator"])
    method = Method(**planned["method"], seed=planned["seed"])
    found = [tables.empty("descriptors", causes)]
    for path, overlap in zip(paths.pairs, paths.overlaps, strict=True):
        (row,) = tables.read(path, "pairs").itertuples()
        if row.registered:
            indices = (row.reference, row.source)
            clouds = [points[index] for index in indices]
            pair = read_pair(*clouds, paths.poses, overlap, indices)
            streams = Streams(planned["seed"], planned["sequence"], *indices)
            returned = (runs.get(indices), estimates.get(indices))
            of_pair = (pair, settings, estimator, streams, *returned, method, ScanPair.of(row))
            found.append(training.examples(*of_pair))
    frame = pd.concat([part for part in found if len(part)] or found[:1])
    data = digests.data_digests(*paths.scans)
    tables.write(output, frame, "descriptors", planned, causes, data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        paths, params = snakemake.input, snakemake.params
        train_estimator(paths, snakemake.output[0], params.plan, params.jobs, params.scans)
