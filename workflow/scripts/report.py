"""Make the report of the selected experiments, and the few lines that end a run."""

from pathlib import Path

import pandas as pd
import yaml

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report import by_estimator, comparison, page
from icpshap.report import what_if as what_if_tables
from icpshap.report.study import Study


def section(
    scope, study, shap, directions, uncertainty, pairs, fit, diagnoses, what_if, figures, rankings
):
    ranking = None
    if rankings:
        ranking = pd.read_csv(rankings[0], keep_default_na=False, na_values=[""])
    return page.Section(
        scope,
        Study(**study),
        tables.read(shap, "shap"),
        tables.read(directions, "directions"),
        tables.read(pairs, "pairs"),
        tables.read(fit, "fit"),
        what_if_tables.read(what_if) if what_if else None,
        ranking,
        figures,
        [
            *(shap, directions, uncertainty, pairs, fit),
            *diagnoses,
            *filter(None, [what_if]),
            *rankings,
        ],
        tables.read_all(diagnoses, "diagnosis"),
    )


def of_estimators(scope, study, parts, table, figure):
    return page.Estimators(scope, Study(**study), by_estimator.read(table), parts, figure, [table])


def make_report(output, sections, joined, provenance, compared, titles):
    sections = [section(**part) for part in sections]
    joined = [of_estimators(**part) for part in joined]
    run = yaml.safe_load(Path(provenance).read_text(encoding="utf-8"))
    against = None
    if compared:
        csv, svg = compared
        table = pd.read_csv(csv)
        against = (svg, comparison.caption(table), comparison.html(table, titles))
    text = page.page(sections, run, Path(output.page).parent, against, joined)
    Path(output.page).write_text(text, encoding="utf-8")
    summary = page.summary(sections, output.page, joined)
    Path(output.summary).write_text(summary, encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        make_report(
            snakemake.output,
            params.sections,
            params.joined,
            snakemake.input.provenance,
            snakemake.input.compared,
            params.titles,
        )
