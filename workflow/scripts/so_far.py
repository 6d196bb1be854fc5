"""Report on the pairs that are finished, while the workflow goes on."""

from icpshap.jobs import provenance, so_far
from icpshap.jobs.job import job


def report_so_far(output, found, studies, figures, config, sequences, root, logs):
    run = provenance.provenance(config, sequences, root, logs)
    return so_far.report(found, studies, figures, run, output)


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        params = snakemake.params
        names = ("found", "studies", "figures", "config", "sequences", "root", "logs")
        given = {name: getattr(params, name) for name in names}
        lines = report_so_far(snakemake.output[0], **given)
        print("Finished so far, of pairs:", *lines, sep="\n  ", file=terminal)
