"""Read a scan of a folder."""

import logging

from icpshap import tables
from icpshap.data import scans as dataset
from icpshap.jobs.logs import job_log


def read_scan(path, output, drop_non_finite):
    points, dropped = dataset.read_scan(path, drop_non_finite)
    logging.info("%s: %d points, %d rows that are not finite dropped", path, len(points), dropped)
    tables.write(output, tables.points_frame(points), "scan", {"dropped_rows": dropped})


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        read_scan(snakemake.input[0], snakemake.output[0], snakemake.params.drop_non_finite)
