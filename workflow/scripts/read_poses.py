"""Read the poses of a folder."""

from icpshap import tables
from icpshap.data import poses
from icpshap.jobs.job import job


def read_poses(path, output, scans, plan):
    tables.write(output, tables.poses_frame(poses.read_poses(path, scans)), "poses", plan)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        read_poses(snakemake.input[0], snakemake.output[0], params.scans, params.plan)
