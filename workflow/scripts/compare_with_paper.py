"""Set the results of every estimator that was run against the paper's."""

from pathlib import Path

import pandas as pd

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report import comparison
from icpshap.report.figures.style import save
from icpshap.report.study import Study


def compare_with_paper(paths, output, sections, titles):
    figures = pd.read_csv(paths.figures)
    parts = []
    for section in sections:
        study = Study(**section["study"])
        if section["rankings"]:
            parts.append(comparison.compare_medians(pd.read_csv(section["rankings"][0]), study))
        else:
            shap = tables.read(section["shap"], "shap")
            parts.append(comparison.compare_figures(shap, figures, study))
    table = pd.concat(parts, ignore_index=True)
    table.to_csv(output.csv, index=False)
    Path(output.md).write_text(comparison.markdown(table, titles), encoding="utf-8")
    save(comparison.draw(table, titles), output.png, output.svg)
    Path(output.caption).write_text(comparison.caption(table) + "\n", encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        compare_with_paper(snakemake.input, snakemake.output, params.sections, params.titles)
