"""Run ICP for a share of the settings of a pair."""

from icpshap import tables
from icpshap.data.pair import read_pair
from icpshap.estimators import monte_carlo as estimators
from icpshap.estimators import perturb as perturbation
from icpshap.jobs import digests as provenance
from icpshap.jobs.logs import job_log
from icpshap.parameters import Perturbation, Registration
from icpshap.plan import Setting


def run_icp(paths, output, sequence, indices, params):
    files = ("reference", "source", "poses")
    decided_by = {name: provenance.file_digest(paths[name]) for name in files}
    for name in ("seed", "registration", "perturbation", "code"):
        decided_by[name] = params[name]
    if not tables.read(paths.pair, "pairs")["registered"].item():
        tables.write(output, tables.empty("runs"), "runs", decided_by)
        return
    runs = estimators.register_settings(
        read_pair(paths.reference, paths.source, paths.poses, paths.overlap, indices),
        [Setting(**{**setting, "values": tuple(setting["values"])}) for setting in params.settings],
        Registration(**params.registration),
        Perturbation(**params.perturbation),
        perturbation.Streams(params.seed, sequence, *indices),
    )
    tables.write(output, runs, "runs", decided_by)


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        wildcards = snakemake.wildcards
        indices = (int(wildcards.reference), int(wildcards.source))
        run_icp(snakemake.input, snakemake.output[0], wildcards.sequence, indices, snakemake.params)
