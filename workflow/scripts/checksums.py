"""Write the checksums of what was made, as sha256sum reads them."""

from pathlib import Path

from icpshap.jobs import digests
from icpshap.jobs.job import job


def checksums(paths, output):
    """A line a file, of its path relative to the folder of the checksums."""
    folder = Path(output).parent
    lines = [
        f"{digests.sha256(path)}  {Path(path).relative_to(folder).as_posix()}\n"
        for path in sorted(set(paths))
    ]
    Path(output).write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    with job(snakemake, __file__):
        checksums(snakemake.input, snakemake.output[0])
