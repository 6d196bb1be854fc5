"""Register two consecutive scans, whose true pose nothing says."""

from dataclasses import asdict

import numpy as np
import pandas as pd

from icpshap import tables
from icpshap.data import poses, registering
from icpshap.jobs.job import job


def register_pair(files, output, indices, scans, plan):
    reference, source = tables.read_points(files.reference), tables.read_points(files.source)
    where = "{}, scans {} and {}".format(plan["sequence"], *indices)
    T_initial = _start(files.guess, plan.get("guess"), indices[0], scans, where)
    found = asdict(registering.register_scans(reference, source, T_initial, where))
    T = found.pop("T_reference_source").ravel()
    row = {"reference": indices[0], "source": indices[1], **found}
    row |= dict(zip(tables.TRANSFORM, T, strict=True))
    tables.write(output, pd.DataFrame([row]), "registrations", plan)


def _start(file, numbers, reference, scans, where):
    """T_reference_source at which ICP starts: of a file, of numbers, or no motion."""
    if file:
        return registering.guesses(poses.read_transforms(file), scans, file)[reference]
    return poses.transform_of(numbers, f"{where}, guess") if numbers else np.eye(4)


if __name__ == "__main__":
    with job(snakemake, __file__):
        wildcards, params = snakemake.wildcards, snakemake.params
        indices = (int(wildcards.reference), int(wildcards.source))
        register_pair(snakemake.input, snakemake.output[0], indices, params.scans, params.plan)
