"""Estimate the poses of a job's settings: pose samples, covariances, or both."""

import numpy as np
import pandas as pd

from icpshap import estimators, plan, tables
from icpshap.data.pair import Pairs
from icpshap.estimators.perturb import Streams
from icpshap.jobs import plans
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def run_icp(paths, outputs, planned):
    estimator = trained(paths.training, planned)
    found = {table: [] for table in outputs}
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)
    checked = tables.read_all(paths.pairs, "pairs").set_index(["reference", "source"])
    parts = [plan.Part(tuple(pair), *ends) for pair, *ends in planned["parts"]]
    registered = [part.pair for part in parts if checked["registered"][part.pair]]

    def estimated(part):
        return estimate(pairs.read(part.pair), part, estimator, planned)

    for of_part in in_turn([part for part in parts if part.pair in registered], estimated, "pairs"):
        for table, frame in of_part.items():
            found[table].append(frame)
    data = pairs.data([part.pair for part in parts])
    about = {"data": data, "registered": registered}
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
        run_icp(snakemake.input, dict(snakemake.output.items()), snakemake.params.plan)
