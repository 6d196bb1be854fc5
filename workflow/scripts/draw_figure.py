"""Draw a figure of an experiment, or of one sequence of it."""

from pathlib import Path

from icpshap import tables
from icpshap.jobs.logs import job_log
from icpshap.report import figures
from icpshap.report.captions import Study
from icpshap.report.figures.style import save


def draw_figure(path, output, name, study):
    figure, caption = figures.draw(name, tables.read(path, "shap"), Study(**study))
    save(figure, output.png, output.svg)
    Path(output.caption).write_text(caption + "\n")


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        draw_figure(
            snakemake.input[0],
            snakemake.output,
            snakemake.wildcards.figure,
            snakemake.params.study,
        )
