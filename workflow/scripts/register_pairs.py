"""Register consecutive scans, whose true poses nothing says."""

from dataclasses import asdict

import numpy as np
import pandas as pd

from icpshap import storage, tables
from icpshap.data import poses, registering
from icpshap.jobs.job import job
from icpshap.jobs.progress import in_turn


def register_pairs(files, output, scans, plan):
    file_of = storage.parts_of(files.scans)

    def registered(indices):
        where = "{}, scans {} and {}".format(plan["sequence"], *indices)
        T_initial = _start(files.guess, plan.get("guess"), indices[0], scans, where)
        names = [tables.scan_part(index) for index in indices]
        of_files = zip((file_of[name][0] for name in names), indices, strict=True)
        (reference, _), (source, _) = (tables.read_scan(*scan) for scan in of_files)
        found = asdict(registering.register_scans(reference, source, T_initial, where))
        T = found.pop("T_reference_source").ravel()
        row = {"reference": indices[0], "source": indices[1], **found}
        return row | dict(zip(tables.TRANSFORM, T, strict=True))

    rows = list(in_turn(plan["pairs"], registered, "pairs"))
    tables.write(output, pd.DataFrame(rows), "registrations", plan)


def _start(file, numbers, reference, scans, where):
    """T_reference_source at which ICP starts: of a file, of numbers, or no motion."""
    if file:
        return registering.guesses(poses.read_transforms(file), scans, file)[reference]
    return poses.transform_of(numbers, f"{where}, guess") if numbers else np.eye(4)


if __name__ == "__main__":
    with job(snakemake, __file__):
        params = snakemake.params
        register_pairs(snakemake.input, snakemake.output[0], params.scans, params.plan)
