"""Draw a figure of an experiment, or of one sequence of it."""

from pathlib import Path

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report import figures
from icpshap.report.figures.style import save
from icpshap.report.study import Study


def draw_figure(paths, output, name, study):
    shap, directions = (tables.read(getattr(paths, of), of) for of in ("shap", "directions"))
    figure, caption = figures.draw(name, shap, directions, Study(**study))
    save(figure, output.png, output.svg)
    Path(output.caption).write_text(caption + "\n", encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        draw_figure(
            snakemake.input,
            snakemake.output,
            snakemake.wildcards.figure,
            snakemake.params.study,
        )
