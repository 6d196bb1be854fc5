"""Divergences of every setting and Shapley values of every instance of a sequence."""

import pandas as pd

from icpshap import explanation, plan, tables
from icpshap.logs import job_log
from icpshap.sources import NAMES, SOURCES


def explain_sequence(paths, output, sequence, levels, estimator, seed):
    instances = pd.DataFrame(plan.instances(levels), columns=NAMES).rename_axis("instance")
    fields = explanation.Method.__dataclass_fields__
    method = explanation.Method(
        **{key: value for key, value in estimator.items() if key in fields}, seed=seed
    )
    parts = []
    for pair in tables.read(paths.pairs, "pairs").itertuples():
        chunks = [path for path in paths.runs if f"/{pair.reference}-{pair.source}/" in path]
        parts.append(
            explanation.explain(
                pd.concat([tables.read(path, "runs") for path in chunks], ignore_index=True),
                instances.reset_index(),
                {source.name: source.off for source in SOURCES},
                method,
                (sequence, pair.reference, pair.source),
                pair.reason,
            )
        )
    decided_by = {"seed": seed, "estimator": estimator}
    for table, frames in zip(("uncertainty", "shap"), zip(*parts, strict=True), strict=True):
        frame = pd.concat(frames, ignore_index=True)
        tables.write(output[table], frame, table, decided_by)


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        explain_sequence(
            snakemake.input,
            snakemake.output,
            snakemake.wildcards.sequence,
            snakemake.params.levels,
            snakemake.params.estimator,
            snakemake.params.seed,
        )
