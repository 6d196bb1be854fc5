"""Put the sequences of an experiment into one table."""

import pandas as pd

from icpshap import tables
from icpshap.jobs.logs import job_log


def join_sequences(paths, output, table):
    frames = [tables.read(path, table) for path in paths]
    tables.write(output, pd.concat(frames, ignore_index=True), table)


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        join_sequences(snakemake.input, snakemake.output[0], snakemake.wildcards.table)
