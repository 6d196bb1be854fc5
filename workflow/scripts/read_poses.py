"""Read the poses of a folder."""

from icpshap import tables
from icpshap.data import scans as dataset
from icpshap.jobs.logs import job_log


def read_poses(path, output, scans):
    tables.write(output, tables.poses_frame(dataset.read_poses(path, scans)), "poses")


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        read_poses(snakemake.input[0], snakemake.output[0], snakemake.params.scans)
