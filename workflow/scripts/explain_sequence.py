"""Divergences of every setting and Shapley values of every instance of a sequence."""

from icpshap import tables
from icpshap.jobs.explained import explained
from icpshap.jobs.job import job


def explain_sequence(paths, output, planned, jobs, checked):
    for table, frame in explained(paths, planned, jobs, checked).items():
        tables.write(output[table], frame, table, planned, list(planned["off"]))


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        given = (params.plan, params.jobs, params.checks)
        explain_sequence(snakemake.input, snakemake.output, *given)
