"""Fetch the poses of an archive."""

from pathlib import Path

from icpshap import tables
from icpshap.data import scans as dataset
from icpshap.data.archive import open_sequence
from icpshap.jobs.logs import job_log


def fetch_poses(archive, cache, output, scans, terminal):
    file = Path(cache) / dataset.LEICA_NAME
    with open_sequence(archive, cache, scans, terminal) as members:
        members.extract_poses(file)
    tables.write(output, tables.poses_frame(dataset.read_poses(file, scans)), "poses")
    file.unlink()


if __name__ == "__main__":
    with job_log(snakemake.log[0]) as terminal:
        fetch_poses(
            snakemake.params.archive,
            snakemake.params.cache,
            snakemake.output[0],
            snakemake.params.scans,
            terminal,
        )
