"""Rank the uncertainty sources of each sequence, and set their medians beside the paper's."""

from pathlib import Path

import pandas as pd

from icpshap import tables
from icpshap.causes import NAMES
from icpshap.explanation import ranking
from icpshap.jobs.logs import job_log
from icpshap.report import tables as layout
from icpshap.report.captions import Study
from icpshap.report.comparison import is_comparable


def median_table(paths, output, study, seed):
    shap = tables.read(paths.shap, "shap")
    paper = pd.read_csv(paths.paper) if is_comparable(shap, study) else None
    resampled = tables.read(paths.resampled, "resampled")
    table = ranking.ranking_table(shap, resampled, NAMES, paper, seed=seed)
    table.to_csv(output.rules, index=False)
    layout.median_rows(table).to_csv(output.csv, index=False)
    Path(output.md).write_text(layout.markdown(table, study))
    Path(output.tex).write_text(layout.latex(table, study))


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        median_table(
            snakemake.input,
            snakemake.output,
            Study(**snakemake.params.study),
            snakemake.params.seed,
        )
