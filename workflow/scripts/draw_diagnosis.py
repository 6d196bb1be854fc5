"""Draw which causes stand out in which pairs of a sequence."""

from pathlib import Path

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report.figures import diagnosis
from icpshap.report.figures.style import save, styled


def draw_diagnosis(path, output, titles):
    table = tables.read(path, "diagnosis")
    with styled():
        figure = diagnosis.picture(table, titles)
    save(figure, output.png, output.svg)
    Path(output.caption).write_text(diagnosis.caption(table) + "\n", encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        draw_diagnosis(snakemake.input[0], snakemake.output, snakemake.params.titles)
