"""Simulate a scan of a built-in scene, or the poses of its scans."""

from icpshap import tables
from icpshap.data import simulate
from icpshap.jobs.job import job


def simulate_sequence(output, scans, plan):
    scene, seed = plan["scene"], plan["seed"]
    scanner = {key: plan[key] for key in ("range_noise", "rings", "speed") if key in plan}
    T_global_scan = simulate.simulate_poses(scene, scans, seed)
    if "index" not in plan:
        tables.write(output, tables.poses_frame(T_global_scan), "poses", plan)
        return
    index = plan["index"]
    T, beams = T_global_scan[index], plan["beams"]
    points = simulate.simulate_scan(scene, index, T, beams, seed, **scanner)
    tables.write_scan(output, points, None, plan)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        simulate_sequence(snakemake.output[0], params.scans, params.plan)
