"""Fetch a scan of an archive."""

import logging
from pathlib import Path

from icpshap import tables
from icpshap.data.archive import open_sequence
from icpshap.data.scans import read_timed_scan
from icpshap.errors import DataError
from icpshap.jobs.job import job

AS_ARCHIVED = (
    "the archive holds it so. Rows that are not finite are accepted with `drop_non_finite: true`;"
    " for anything else extract the archive, mend the file, and set `archive: null` and"
    " `folder: {path: <what holds csv_local/>}`."
)


def fetch_scan(archive, cache, output, scans, plan, terminal):
    index = plan["index"]
    file = Path(cache) / f"scan_{index}.csv"
    with open_sequence(archive, cache, scans, terminal) as members:
        members.extract_scan(index, file)
    where = f"{archive.get('path') or archive['url']}, Hokuyo_{index}.csv"
    try:
        points, times, dropped = read_timed_scan(file, plan.get("time"), plan["drop_non_finite"])
    except DataError as error:
        # The extracted file is no place to mend anything: the next run extracts it again.
        problem = str(error).partition("\nHint: ")[0].replace(str(file), where)
        raise DataError(problem, AS_ARCHIVED) from None
    finally:
        file.unlink()
    logging.info("%s: %d points, %d rows that are not finite dropped", where, len(points), dropped)
    tables.write_scans(output, [(index, points, times, dropped)], plan)


if __name__ == "__main__":
    with job(snakemake, __file__) as terminal:
        fetch_scan(
            snakemake.params.archive,
            snakemake.params.cache,
            snakemake.output[0],
            len(tables.read_poses(snakemake.input.poses)),
            snakemake.params.plan,
            terminal,
        )
