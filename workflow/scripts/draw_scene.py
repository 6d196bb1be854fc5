"""Draw the scans and the poses of a pair: a picture and an interactive page."""

from pathlib import Path

from icpshap import tables
from icpshap.data.pair import Pairs
from icpshap.estimators import Estimator
from icpshap.estimators.perturb import Draws, Perturbation, Streams
from icpshap.explanation.method import Method
from icpshap.jobs.job import job
from icpshap.plan import Setting
from icpshap.report.figures import scene
from icpshap.report.figures.style import save
from icpshap.report.study import Study


def draw_scene(paths, output, sequence, indices, params):
    pairs = tables.read(paths.pairs, "pairs")
    row = next(pairs[(pairs.reference == indices[0]) & (pairs.source == indices[1])].itertuples())
    pair = Pairs(paths.scans, paths.poses, paths.overlaps).read(indices)
    runs = tables.read_all(paths.runs, "runs") if paths.runs else None
    if runs is not None:
        runs = runs[(runs.reference == indices[0]) & (runs.source == indices[1])]
    draws = Draws(
        pair,
        Estimator.decided(params.estimator),
        Perturbation(**params.perturbation).deviation,
        Streams(params.seed, sequence, *indices),
    )
    # Of a pair that is not registered nothing was removed, and perhaps nothing can be.
    setting = Setting.at(params.instance if row.registered else {})
    kept = (draws.left(setting, scan, 0) for scan in ("reference", "source"))
    read_by = Method(**params.method), row.characteristic_length
    shown = scene.make_scene(pair, *kept, runs, params.instance, *read_by)
    study = Study(**params.study)
    save(scene.picture(shown), output.png, output.svg)
    caption = scene.caption(shown, study, row)
    Path(output.caption).write_text(caption + "\n", encoding="utf-8")
    text = scene.page_caption(shown, study, row)
    Path(output.page).write_text(scene.page(shown, study.pair(row), text), encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        wildcards = snakemake.wildcards
        draw_scene(
            snakemake.input,
            snakemake.output,
            wildcards.sequence,
            (int(wildcards.reference), int(wildcards.source)),
            snakemake.params,
        )
