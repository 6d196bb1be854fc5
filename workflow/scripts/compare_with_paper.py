"""Set the results of every estimator that was run against the paper's."""

from pathlib import Path

import pandas as pd

from icpshap import tables
from icpshap.jobs.logs import job_log
from icpshap.report import comparison
from icpshap.report.captions import Study
from icpshap.report.figures.style import save


def compare_with_paper(paths, output, sections, titles):
    figures = pd.read_csv(paths.figures)
    parts = []
    for part in sections:
        study, folder = Study(**part["study"]), f"results/{part['scope']}"
        if part["rankings"]:
            parts.append(comparison.compare_medians(pd.read_csv(part["rankings"][0]), study))
        else:
            shap = tables.read(f"{folder}/shap.parquet", "shap")
            parts.append(comparison.compare_figures(shap, figures, study))
    table = pd.concat(parts, ignore_index=True)
    table.to_csv(output.csv, index=False)
    Path(output.md).write_text(comparison.markdown(table, titles))
    save(comparison.draw(table, titles), output.png, output.svg)
    Path(output.caption).write_text(comparison.caption(table) + "\n")


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        compare_with_paper(
            snakemake.input,
            snakemake.output,
            snakemake.params.sections,
            snakemake.params.titles,
        )
