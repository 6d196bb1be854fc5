"""Set the estimators of an experiment of several side by side."""

from pathlib import Path

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report import by_estimator
from icpshap.report.figures import estimators
from icpshap.report.figures.style import save
from icpshap.report.study import Study


def join_estimators(paths, output, studies, study):
    found = [
        by_estimator.Part(
            Study(**part),
            tables.read(shap, "shap"),
            tables.read(uncertainty, "uncertainty"),
        )
        for part, shap, uncertainty in zip(studies, paths.shap, paths.uncertainty, strict=True)
    ]
    table = by_estimator.joined(found)
    table.to_csv(output.csv, index=False)
    Path(output.md).write_text(by_estimator.markdown(table, study), encoding="utf-8")
    Path(output.tex).write_text(by_estimator.latex(table, study), encoding="utf-8")
    save(estimators.picture(table, study), output.png, output.svg)
    caption = by_estimator.caption(table, study)
    Path(output.caption).write_text(caption + "\n", encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        study = Study(**params.study)
        join_estimators(snakemake.input, snakemake.output, params.studies, study)
