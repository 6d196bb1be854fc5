"""Simulate the poses of the scans of a built-in scene."""

from icpshap import tables
from icpshap.data import simulate
from icpshap.jobs.job import job


def simulate_poses(output, scans, plan):
    T_global_scan = simulate.simulate_poses(plan["scene"], scans, plan["seed"])
    tables.write(output, tables.poses_frame(T_global_scan), "poses", plan)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        simulate_poses(snakemake.output[0], params.scans, params.plan)
