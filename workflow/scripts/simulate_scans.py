"""Simulate scans of a built-in scene."""

from icpshap import tables
from icpshap.data import simulate
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def simulate_scans(output, plan):
    scene, seed, beams = plan["scene"], plan["seed"], plan["beams"]
    scanner = {key: plan[key] for key in ("range_noise", "rings", "speed") if key in plan}
    T_global_scan = simulate.simulate_poses(scene, plan["scans"][-1] + 1, seed)

    def simulated(index):
        T = T_global_scan[index]
        return index, simulate.simulate_scan(scene, index, T, beams, seed, **scanner), None, 0

    tables.write_scans(output, in_turn(plan["scans"], simulated, "scans"), plan)


if __name__ == "__main__":
    with job(snakemake, __file__):
        simulate_scans(snakemake.output[0], snakemake.params.plan)
