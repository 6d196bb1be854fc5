"""Write down what the selected experiments were made with."""

from pathlib import Path

import yaml

from icpshap.jobs import provenance
from icpshap.jobs.job import job


def write_provenance(output, config, sequences, root, logs):
    made_with = provenance.provenance(config, sequences, root, logs)
    text = yaml.safe_dump(made_with, sort_keys=False, allow_unicode=True)
    Path(output).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        write_provenance(
            snakemake.output[0],
            snakemake.params.config,
            snakemake.params.sequences,
            snakemake.params.root,
            snakemake.params.logs,
        )
