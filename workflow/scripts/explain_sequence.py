"""Divergences of every setting and Shapley values of every instance of a sequence."""

import pandas as pd

from icpshap import plan, tables
from icpshap.estimators.kind import Returns
from icpshap.explanation import games
from icpshap.explanation.method import Method
from icpshap.fit import checks
from icpshap.jobs import plans, played
from icpshap.jobs.job import job


def explain_sequence(paths, output, planned, jobs, checked):
    causes = list(planned["off"])
    method = Method(**planned["method"], seed=planned["seed"])
    for files in (paths.pairs, paths.fit):
        for path, expected in zip(files, checked, strict=True):
            plans.check(path, expected)
    pairs = tables.read_all(paths.pairs, "pairs")
    found = played.games(pairs, planned, paths.instances)
    for files in filter(None, (paths.runs, paths.estimates)):
        plans.check_estimates(files, jobs, planned, paths.pairs)
    runs, estimates = (tables.ByPair(paths[name], name) for name in ("runs", "estimates"))
    pairs = played.described(pairs, found)
    rows = played.by_pair(pairs)
    made = {"pairs": [pairs], **{name: [] for name in games.Explanation._fields}}
    made["resampled"] = [tables.empty("resampled", causes, planned)]
    for indices, game in found.items():
        instances = pd.DataFrame(plan.instances(game.levels), columns=causes)
        instances = instances.rename_axis("instance").reset_index()
        returned = (runs.get(indices), estimates.get(indices))
        read_by = (planned["off"], Returns(**planned["returns"]), method)
        arguments = (*returned, instances, *read_by, played.scan_pair(game, rows, planned))
        explained = games.explain(*arguments, game.reason)._asdict()
        for table, frame in explained.items():
            made[table].append(frame)
        if not game.reason:
            made["resampled"].append(games.resampled_values(*arguments))
    joined = {table: pd.concat(frames, ignore_index=True) for table, frames in made.items()}
    numbers = tables.read_all(paths.fit, "fit_numbers")
    run = played.as_run(joined["uncertainty"], planned)
    joined["fit"] = checks.complete(numbers, run, planned["off"])
    broken = checks.marked(played.as_run(joined["shap"], planned), joined["fit"]).misfit
    joined["shap"] = joined["shap"].assign(misfit=broken)
    for table, frame in joined.items():
        tables.write(output[table], frame, table, planned, causes)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        given = (params.plan, params.jobs, params.checks)
        explain_sequence(snakemake.input, snakemake.output, *given)
