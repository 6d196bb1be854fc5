"""Rank the causes of each sequence, and set their medians beside the paper's."""

from pathlib import Path

import pandas as pd

from icpshap import tables
from icpshap.explanation import ranking
from icpshap.jobs.job import job
from icpshap.report import comparison, fit
from icpshap.report import tables as layout
from icpshap.report.study import Study


def median_table(paths, output, study, seed):
    shap = tables.read(paths.shap, "shap")
    paper = pd.read_csv(paths.paper) if comparison.is_comparable(shap, study) else None
    resampled = tables.read(paths.resampled, "resampled")
    order = comparison.PAPER_ORDER
    table = ranking.ranking_table(shap, resampled, list(study.causes), paper, order, seed)
    table.to_csv(output.rules, index=False)
    layout.median_rows(table).to_csv(output.csv, index=False)
    broken = fit.misfits(shap, study)
    text = fit.first(layout.markdown(table, study), broken)
    Path(output.md).write_text(text, encoding="utf-8")
    text = fit.first(layout.latex(table, study), broken, mark="% ")
    Path(output.tex).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        median_table(snakemake.input, snakemake.output, Study(**params.study), params.seed)
