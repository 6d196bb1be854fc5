"""Estimate the poses of a job's settings: pose samples, covariances, or both."""

import numpy as np
import pandas as pd

from icpshap import estimators, plan, tables
from icpshap.data.pair import Pairs
from icpshap.estimators.perturb import Streams
from icpshap.jobs import plans, played
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def run_icp(paths, outputs, planned):
    estimator = trained(paths.training, planned)
    found = {table: [] for table in outputs}
    pairs = Pairs(paths.scans, paths.poses, paths.overlaps)
    games = played.games(tables.read_all(paths.pairs, "pairs"), planned, paths.instances)
    parts = [plan.Part(tuple(pair), *ends) for pair, *ends in planned["parts"]]
    settings = {part.pair: games[part.pair].settings(part, planned["replicates"]) for part in parts}
    registered = [pair for pair in settings if settings[pair]]

    def estimated(pair):
        game = games[pair]
        return estimate(pairs.read(game.run), settings[pair], estimator, planned, game)

    for of_pair in in_turn(registered, estimated, "pairs"):
        for table, frame in of_pair.items():
            found[table].append(frame)
    data = pairs.data([games[pair].run or pair for pair in settings])
    about = {"data": data, "registered": registered}
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
        run_icp(snakemake.input, dict(snakemake.output.items()), snakemake.params.plan)
