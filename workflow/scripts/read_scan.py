"""Read a scan of a folder."""

import logging

from icpshap import tables
from icpshap.data import scans
from icpshap.jobs.job import job


def read_scan(path, output, plan):
    points, times, dropped = scans.read_timed_scan(
        path, plan.get("time"), plan["drop_non_finite"], plan.get("columns")
    )
    logging.info("%s: %d points, %d rows that are not finite dropped", path, len(points), dropped)
    tables.write_scan(output, points, times, plan, dropped_rows=dropped)


if __name__ == "__main__":
    with job(snakemake, __file__):
        read_scan(snakemake.input[0], snakemake.output[0], snakemake.params.plan)
