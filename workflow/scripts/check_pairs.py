"""Describe pairs, and stop before any is registered that cannot be perturbed as asked."""

import pandas as pd

from icpshap import tables
from icpshap.causes import CAUSES
from icpshap.data.pair import Pairs, describe_pair
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Streams, require_points
from icpshap.fit import checks
from icpshap.fit.measure import measure
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn
from icpshap.plan import Setting


def check_pairs(paths, output, plan, stop_at_red, title, terminal):
    pairs = Pairs(paths.scans, paths.poses)
    truth = tables.read_about(paths.poses).get("truth", "")

    def found_of(indices):
        pair = pairs.measured(indices, plan["distance"])
        row, numbers = described(pair, indices, plan, truth)
        for remark in filter(None, (row["reason"], row["warning"])):
            if remark != truth:  # said once, of the whole sequence
                name = tables.pair_part(indices)
                print(f"{plan['sequence']} {name}: {remark}", file=terminal)
        if stop_at_red:
            checks.require_fit(pd.DataFrame([numbers]), (plan["sequence"], *indices))
        return row, numbers, (indices, pair.overlapping, pair.overlap)

    rows, numbers, overlaps = zip(*in_turn(plan["pairs"], found_of, "pairs"), strict=True)
    numbers = pd.DataFrame(numbers)
    print(*checks.lines(checks.table(numbers), title), sep="\n", file=terminal)
    tables.write_overlaps(output.overlaps, overlaps, plan)
    data = pairs.data(plan["pairs"])
    tables.write(output.fit_numbers, numbers, "fit_numbers", plan, data=data)
    tables.write(output.pairs, pd.DataFrame(rows), "pairs", plan, data=data)


def described(pair, indices, plan, truth):
    """The rows of a pair in the tables of pairs and of fit numbers."""
    levels = {name: level for name, _, level in plan["levels"]}
    estimator = Estimator.decided(plan["estimator"])
    streams = Streams(plan["seed"], plan["sequence"], *indices)
    row = describe_pair(
        pair,
        plan["sequence"],
        indices,
        levels=[(CAUSES[name](**options), level) for name, options, level in plan["levels"]],
        minimum_overlap=plan["minimum_overlap"],
        minimum_range=estimator.perturbing.minimum_range,
        truth=truth,
    )
    # What is diagnosed of a pair need not be played on it.
    counts = any(cause.counts_points for cause in estimator.causes.values())
    if row["registered"] and counts and not tables.is_here(plan):
        require_points(pair, Setting.at(levels), estimator, streams)
    named = {key: row[key] for key in tables.PAIR}
    return row, {**named, **measure(pair, estimator, levels, streams)}


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        params, wildcards = snakemake.params, snakemake.wildcards
        # By its key, since another title would check again, and explain what follows.
        title = f"{wildcards.experiment}, {wildcards.sequence}"
        if int(wildcards.batch):
            title += " from {}-{}".format(*params.plan["pairs"][0])
        given = (snakemake.input, snakemake.output, params.plan, params.stop_at_red)
        check_pairs(*given, title, terminal)
