"""Estimate the poses of a job's settings: pose samples, covariances, or both."""

import numpy as np
import pandas as pd

from icpshap import estimators, plan, tables
from icpshap.data.pair import read_pair
from icpshap.estimators.perturb import Streams
from icpshap.jobs import digests, plans
from icpshap.jobs.job import job


def run_icp(paths, outputs, planned, scans):
    estimator = trained(paths.training, planned)
    found = {table: [] for table in outputs}
    points = dict(zip(scans, paths.scans, strict=True))
    registered = []
    for part, overlap, pair in zip(planned["parts"], paths.overlaps, paths.pairs, strict=True):
        part = plan.Part(tuple(part[0]), *part[1:])
        if tables.read(pair, "pairs")["registered"].item():
            clouds = [points[index] for index in part.pair]
            of_pair = read_pair(*clouds, paths.poses, overlap, part.pair)
            for table, frame in estimate(of_pair, part, estimator, planned).items():
                found[table].append(frame)
            registered.append(part.pair)
    about = {"data": digests.data_digests(*paths.scans), "registered": registered}
    causes = list(planned["levels"])
    for table, output in outputs.items():
        frame = pd.concat(found[table]) if registered else tables.empty(table, causes)
        tables.write(output, frame, table, planned, causes, **about)


def trained(paths, planned):
    """The estimator, after it has learned from the descriptors tables of the plan, if it does."""
    estimator = estimators.Estimator.decided(planned["estimator"])
    if "training" not in planned:
        return estimator
    for path, (_, expected) in zip(paths, planned["training"], strict=True):
        plans.check(path, expected)
    return estimator.trained(tables.read_all(paths, "descriptors"), planned["sequence"])


def estimate(pair, part, estimator, planned):
    """The tables of one pair by name."""
    settings = plan.settings(planned["levels"], planned["replicates"])[part.start : part.stop]
    runs, estimates = estimators.estimate(
        pair,
        settings,
        estimator,
        np.array(planned["deviation"]),
        Streams(planned["seed"], planned["sequence"], *part.pair),
    )
    reference, source = part.pair
    return {
        name: table.assign(reference=reference, source=source)
        for name, table in (("runs", runs), ("estimates", estimates))
        if table is not None
    }


if __name__ == "__main__":
    with job(snakemake, __file__):
        outputs, params = dict(snakemake.output.items()), snakemake.params
        run_icp(snakemake.input, outputs, params.plan, params.scans)
