"""Read the poses of a folder."""

from icpshap import tables
from icpshap.data import poses
from icpshap.data.scans import read_scan
from icpshap.jobs.job import job


def read_poses(path, output, scans, names, drop_non_finite, plan):
    def points(index):
        return read_scan(scans[index], drop_non_finite, plan.get("columns"))[0]

    found = poses.read_poses(path, len(scans), names, plan.get("quaternion"), points)
    tables.write(output, tables.poses_frame(found), "poses", plan)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        names, drop = params.names, params.drop_non_finite
        read_poses(snakemake.input[0], snakemake.output[0], params.scans, names, drop, params.plan)
