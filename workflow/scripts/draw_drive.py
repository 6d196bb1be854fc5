"""Draw the numbers of a sequence along it, and list the pairs that are most in doubt."""

from pathlib import Path

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report import figures, in_doubt
from icpshap.report.figures.style import save
from icpshap.report.study import Study


def draw_drive(path, output, study):
    study = Study(**study)
    shap = tables.read(path, "shap")
    figure, caption = figures.draw("drive", shap, None, study)
    save(figure, output.png, output.svg)
    Path(output.caption).write_text(caption + "\n", encoding="utf-8")
    ranking = in_doubt.ranking(study.instance(shap, study.waterfall), study)
    ranking.to_csv(output.csv, index=False)


if __name__ == "__main__":
    with job(snakemake, __file__):
        draw_drive(snakemake.input.shap, snakemake.output, snakemake.params.study)
