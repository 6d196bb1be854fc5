"""Chain the registrations of consecutive scans into poses."""

from icpshap import tables
from icpshap.data.registering import TRUTH, chained
from icpshap.jobs.job import job


def register_poses(files, output, plan, terminal):
    found = tables.read_all(files, "registrations")
    T_between = found[tables.TRANSFORM].to_numpy().reshape(-1, 4, 4)
    print(f"{plan['sequence']}: {TRUTH}", file=terminal)
    tables.write(output, tables.poses_frame(chained(T_between)), "poses", plan, truth=TRUTH)


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        register_poses(snakemake.input, snakemake.output[0], snakemake.params.plan, terminal)
