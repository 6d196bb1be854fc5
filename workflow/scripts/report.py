"""Make the report of the selected experiments, and the few lines that end a run."""

from pathlib import Path

import pandas as pd
import yaml

from icpshap import tables
from icpshap.jobs.logs import job_log
from icpshap.report import comparison
from icpshap.report import page as report
from icpshap.report.captions import Study


def section(scope, study, figures, rankings):
    folder = f"results/{scope}"
    return report.Section(
        scope,
        Study(**study),
        tables.read(f"{folder}/shap.parquet", "shap"),
        tables.read(f"{folder}/pairs.parquet", "pairs"),
        pd.read_csv(rankings[0], keep_default_na=False, na_values=[""]) if rankings else None,
        figures,
        [f"{folder}/{name}.parquet" for name in ("shap", "uncertainty", "pairs")] + rankings,
    )


def make_report(output, sections, provenance, compared, titles):
    sections = [section(**part) for part in sections]
    run = yaml.safe_load(Path(provenance).read_text())
    against = None
    if compared:
        csv, svg = compared
        table = pd.read_csv(csv)
        against = (svg, comparison.caption(table), comparison.html(table, titles))
    Path(output.page).write_text(report.page(sections, run, "results", against))
    Path(output.summary).write_text(report.summary(sections, output.page))


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        make_report(
            snakemake.output,
            snakemake.params.sections,
            snakemake.input.provenance,
            snakemake.input.compared,
            snakemake.params.titles,
        )
