"""Draw the scans and the poses of a pair: a picture and an interactive page."""

from pathlib import Path

import pandas as pd

from icpshap import tables
from icpshap.data.pair import read_pair
from icpshap.estimators import perturb as perturbation
from icpshap.jobs.logs import job_log
from icpshap.report.captions import Study
from icpshap.report.figures import scene
from icpshap.report.figures.style import save


def draw_scene(paths, output, sequence, indices, values, seed, study):
    pairs = tables.read(paths.pairs, "pairs")
    row = next(pairs[(pairs.reference == indices[0]) & (pairs.source == indices[1])].itertuples())
    shown = scene.make_scene(
        read_pair(paths.reference, paths.source, paths.poses, paths.overlap, indices),
        pd.concat([tables.read(path, "runs") for path in paths.runs], ignore_index=True),
        values,
        perturbation.Streams(seed, sequence, *indices),
    )
    save(scene.picture(shown), output.png, output.svg)
    Path(output.caption).write_text(scene.caption(shown, study, row) + "\n")
    text = scene.page_caption(shown, study, row)
    Path(output.page).write_text(scene.page(shown, study.pair(row), text))


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        wildcards = snakemake.wildcards
        draw_scene(
            snakemake.input,
            snakemake.output,
            wildcards.sequence,
            (int(wildcards.reference), int(wildcards.source)),
            snakemake.params.perturbation,
            snakemake.params.seed,
            Study(**snakemake.params.study),
        )
