"""Fetch a scan of an archive."""

from pathlib import Path

from icpshap import dataset, tables
from icpshap.fetch import open_sequence
from icpshap.logs import job_log


def fetch_scan(archive, cache, output, index, scans, drop_non_finite, terminal):
    file = Path(cache) / f"scan_{index}.csv"
    with open_sequence(archive, cache, scans, terminal) as members:
        members.extract_scan(index, file)
    points, dropped = dataset.read_scan(file, drop_non_finite)
    tables.write(output, tables.points_frame(points), "scan", {"dropped_rows": dropped})
    file.unlink()


if __name__ == "__main__":
    with job_log(snakemake.log[0]) as terminal:
        fetch_scan(
            snakemake.params.archive,
            snakemake.params.cache,
            snakemake.output[0],
            int(snakemake.wildcards.index),
            snakemake.params.scans,
            snakemake.params.drop_non_finite,
            terminal,
        )
