"""Divergences of every setting and Shapley values of every instance of a sequence."""

import pandas as pd

from icpshap import plan, tables
from icpshap.causes import NAMES, SOURCES
from icpshap.explanation import games as explanation
from icpshap.jobs.logs import job_log


def explain_sequence(paths, output, sequence, levels, method, seed):
    sources = {source.name: source.off for source in SOURCES}
    instances = pd.DataFrame(plan.instances(levels), columns=NAMES)
    instances = instances.rename_axis("instance").reset_index()
    pairs = pd.concat([tables.read(path, "pairs") for path in paths.pairs], ignore_index=True)
    made = {"pairs": [pairs], "uncertainty": [], "shap": []}
    made["resampled"] = [tables.empty("resampled")]
    for pair in pairs.itertuples():
        chunks = [path for path in paths.runs if f"/{pair.reference}-{pair.source}/" in path]
        runs = pd.concat([tables.read(path, "runs") for path in chunks], ignore_index=True)
        indices = (sequence, pair.reference, pair.source)
        arguments = (runs, instances, sources, explanation.Method(**method, seed=seed), indices)
        uncertainty, shap = explanation.explain(*arguments, pair.reason)
        made["uncertainty"].append(uncertainty)
        made["shap"].append(shap)
        if pair.registered:
            made["resampled"].append(explanation.resampled_values(*arguments))
    registration = tables.read_metadata(paths.runs[0])["registration"]
    decided_by = {"seed": seed, "method": method, "registration": registration}
    for table, frames in made.items():
        tables.write(output[table], pd.concat(frames, ignore_index=True), table, decided_by)


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        explain_sequence(
            snakemake.input,
            snakemake.output,
            snakemake.wildcards.sequence,
            snakemake.params.levels,
            snakemake.params.method,
            snakemake.params.seed,
        )
