"""Set the explained instance beside what it becomes with other options."""

from pathlib import Path

from icpshap import tables
from icpshap.jobs.job import job
from icpshap.report import fit, what_if
from icpshap.report.study import Study


def join_what_if(paths, outputs, study, changes):
    first, *others = (tables.read(path, "shap") for path in paths.shap)
    parts = [(what_if.AS_IT_IS, {}, study.instance(first, study.waterfall))]
    parts += [(name, changes[name], shap) for name, shap in zip(changes, others, strict=True)]
    joined = what_if.table(parts, tables.read(paths.pairs, "pairs"))
    joined.to_csv(outputs.csv, index=False)
    text = fit.first(what_if.markdown(joined, study), fit.misfits(first, study))
    Path(outputs.md).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        join_what_if(snakemake.input, snakemake.output, Study(**params.study), params.changes)
