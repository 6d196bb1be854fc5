"""Put the sequences of an experiment into one table of each kind."""

from icpshap import tables
from icpshap.jobs import plans
from icpshap.jobs.job import job


def join_sequences(paths, outputs, plan):
    for table, output in outputs.items():
        for path, (_, planned) in zip(paths[table], plan["sequences"], strict=True):
            plans.check(path, planned)
        tables.write(output, tables.read_all(paths[table], table), table, plan, plan["causes"])


if __name__ == "__main__":
    with job(snakemake, __file__):
        outputs = dict(snakemake.output.items())
        join_sequences(snakemake.input, outputs, snakemake.params.plan)
