"""Fetch the poses of an archive."""

from pathlib import Path

from icpshap import tables
from icpshap.data.archive import open_sequence
from icpshap.data.layout import LEICA_NAME
from icpshap.data.poses import read_poses
from icpshap.jobs.job import job


def fetch_poses(archive, cache, output, scans, plan, terminal):
    file = Path(cache) / LEICA_NAME
    with open_sequence(archive, cache, scans, terminal) as members:
        members.extract_poses(file)
    try:
        poses = read_poses(file, scans)
    finally:
        file.unlink()
    tables.write(output, tables.poses_frame(poses), "poses", plan)


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        fetch_poses(
            snakemake.params.archive,
            snakemake.params.cache,
            snakemake.output[0],
            snakemake.params.scans,
            snakemake.params.plan,
            terminal,
        )
