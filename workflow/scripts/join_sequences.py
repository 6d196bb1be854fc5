"""Put the sequences of an experiment into one table."""

from icpshap import tables
from icpshap.jobs import plans
from icpshap.jobs.job import job


def join_sequences(paths, output, table, plan):
    for path, (_, planned) in zip(paths, plan["sequences"], strict=True):
        plans.check(path, planned)
    tables.write(output, tables.read_all(paths, table), table, plan, plan["causes"])


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        table = snakemake.wildcards.table
        join_sequences(snakemake.input, snakemake.output[0], table, params.plan)
