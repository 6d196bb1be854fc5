"""List the pairs of a sequence, and stop before any registration if one cannot be perturbed."""

from icpshap import tables
from icpshap.logs import job_log
from icpshap.pairs import list_pairs


def check_pairs(
    sequence, indices, paths, output, largest_reduction, minimum_overlap, minimum_range
):
    scans = sorted({index for pair in indices for index in pair})
    overlaps = [tables.read_metadata(path)["overlap"] for path in paths.overlaps]
    table = list_pairs(
        sequence,
        {i: tables.read_points(path) for i, path in zip(scans, paths.scans, strict=True)},
        tables.read_poses(paths.poses),
        dict(zip(indices, overlaps, strict=True)),
        largest_reduction,
        minimum_overlap,
        minimum_range,
    )
    tables.write(output, table, "pairs")


if __name__ == "__main__":
    with job_log(snakemake.log[0]):
        check_pairs(
            snakemake.wildcards.sequence,
            [tuple(pair) for pair in snakemake.params.pairs],
            snakemake.input,
            snakemake.output[0],
            snakemake.params.largest_reduction,
            snakemake.params.minimum_overlap,
            snakemake.params.minimum_range,
        )
