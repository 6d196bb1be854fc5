"""Put what jobs found of some pairs of a sequence each into the table of all of its pairs."""

from icpshap import tables
from icpshap.jobs import plans
from icpshap.jobs.job import job


def join_pairs(files, output, table, plan, batches):
    data = {}
    for path, planned in zip(files, batches, strict=True):
        plans.check(path, planned)
        data |= tables.read_about(path)["data"]
    found = tables.read_all(files, table)
    tables.write(output, found, table, plan, plan["causes"], data=data)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params, table = snakemake.params, snakemake.wildcards.table
        join_pairs(snakemake.input, snakemake.output[0], table, params.plan, params.batches)
