"""Estimate the poses of a job's settings: pose samples, covariances, or both."""

import numpy as np
import pandas as pd

from icpshap import estimators, plan, tables
from icpshap.data.pair import read_pair
from icpshap.estimators.perturb import Streams
from icpshap.jobs import digests, plans, played
from icpshap.jobs.job import job


def run_icp(paths, outputs, planned, scans, overlaps):
    estimator = trained(paths.training, planned)
    found = {table: [] for table in outputs}
    points = dict(zip(scans, paths.scans, strict=True))
    overlaps = dict(zip(overlaps, paths.overlaps, strict=True))
    games = played.games(tables.read_all(paths.pairs, "pairs"), planned, paths.instances)
    registered = []
    for part in (plan.Part(tuple(pair), *ends) for pair, *ends in planned["parts"]):
        game = games[part.pair]
        if settings := game.settings(part, planned["replicates"]):
            clouds = [points[index] for index in game.run]
            of_pair = read_pair(*clouds, paths.poses, overlaps[game.run], game.run)
            for table, frame in estimate(of_pair, settings, estimator, planned, game).items():
                found[table].append(frame)
            registered.append(part.pair)
    about = {"data": digests.data_digests(*paths.scans), "registered": registered}
    causes = [*planned["levels"], *planned.get("measured", ())]
    for table, output in outputs.items():
        frame = pd.concat(found[table]) if registered else tables.empty(table, causes, planned)
        tables.write(output, frame, table, planned, causes, **about)


def trained(paths, planned):
    """The estimator, after it has learned from the descriptors tables of the plan, if it does."""
    estimator = estimators.Estimator.decided(planned["estimator"])
    if "training" not in planned:
        return estimator
    for path, (_, expected) in zip(paths, planned["training"], strict=True):
        plans.check(path, expected)
    return estimator.trained(tables.read_all(paths, "descriptors"), planned["sequence"])


def estimate(pair, settings, estimator, planned, game):
    """The tables of a pair's settings by name, with the indices of the pair whose game it is."""
    runs, estimates = estimators.estimate(
        pair,
        settings,
        estimator,
        np.array(planned["deviation"]),
        Streams(planned["seed"], planned["sequence"], *game.run),
    )
    named = dict(zip(("reference", "source"), game.pair, strict=True))
    named |= dict(zip(tables.PLAYED, game.run, strict=True)) if tables.is_here(planned) else {}
    return {
        name: table.assign(**named)
        for name, table in (("runs", runs), ("estimates", estimates))
        if table is not None
    }


if __name__ == "__main__":
    with job(snakemake, __file__):
        outputs, params = dict(snakemake.output.items()), snakemake.params
        run_icp(snakemake.input, outputs, params.plan, params.scans, params.overlaps)
