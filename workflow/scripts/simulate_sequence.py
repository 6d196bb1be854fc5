"""Simulate a scan of a built-in scene, or the poses of its scans."""

from icpshap import tables
from icpshap.data import simulate
from icpshap.jobs.logs import job_log


def simulate_sequence(part, output, scans, scene, beams, seed):
    T_global_scan = simulate.simulate_poses(scene, scans, seed)
    decided_by = {"seed": seed, "scene": scene, "beams": beams}
    if part == "poses":
        tables.write(output, tables.poses_frame(T_global_scan), "poses", decided_by)
        return
    index = int(part.removeprefix("scan_"))
    points = simulate.simulate_scan(scene, index, T_global_scan[index], beams, seed)
    tables.write(output, tables.points_frame(points), "scan", decided_by)


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        simulate_sequence(
            snakemake.wildcards.part,
            snakemake.output[0],
            snakemake.params.scans,
            **snakemake.params.simulated,
            seed=snakemake.params.seed,
        )
