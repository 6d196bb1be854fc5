"""Read scans of a folder."""

import logging

from icpshap import tables
from icpshap.data import scans
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def read_scans(paths, output, indices, plan):
    def read(scan):
        index, path = scan
        read_as = plan.get("time"), plan["drop_non_finite"], plan.get("columns")
        points, times, dropped = scans.read_timed_scan(path, *read_as)
        said = "%s: %d points, %d rows that are not finite dropped"
        logging.info(said, path, len(points), dropped)
        return index, points, times, dropped

    found = list(zip(indices, paths, strict=True))
    tables.write_scans(output, in_turn(found, read, "scans"), plan)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        read_scans(snakemake.input, snakemake.output[0], params.indices, params.plan)
