"""Write down what the selected experiments were made with."""

from pathlib import Path

import yaml

from icpshap.jobs import provenance as record
from icpshap.jobs.logs import job_log


def provenance(output, config, sequences, root):
    made_with = record.provenance(config, sequences, root, "logs")
    Path(output).write_text(yaml.safe_dump(made_with, sort_keys=False, allow_unicode=True))


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        provenance(
            snakemake.output[0],
            snakemake.config,
            snakemake.params.sequences,
            snakemake.params.root,
        )
