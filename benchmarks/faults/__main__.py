"""Try faults on the workflow and count what comes of them.

    python -m benchmarks.faults [--short] [--seed N] [--only FAMILY ...] [--keep FOLDER]

Prints a line for each outcome that must not be, a table of the families and, as its last line, JSON
with the keys faults, wrong, crash and hang; the exit code is 0 if the last three are.
"""

import argparse
import sys
import tempfile
from pathlib import Path

from benchmarks.faults import campaign, outcome


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--short", action="store_true", help="what continuous integration tries")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=list(campaign.FAMILIES), metavar="FAMILY")
    parser.add_argument("--keep", type=Path, help="a folder to work in, which stays")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="faults_") as folder:
        folder = arguments.keep or Path(folder)
        folder.mkdir(exist_ok=True)
        tried = []
        for one in campaign.run(folder, arguments.seed, arguments.short, arguments.only):
            tried.append(one)
            if one.outcome.kind in outcome.BAD:
                print(f"{one.outcome.kind}: {one.family}: {one.fault}\n    {one.outcome.detail}")
            if arguments.keep:
                with open(folder / "tried.txt", "a", encoding="utf-8") as file:
                    print(one.outcome.kind, one.family, one.fault, one.outcome.detail, file=file)
    print(outcome.table(tried))
    print(outcome.summary(tried), flush=True)
    return any(one.outcome.kind in outcome.BAD for one in tried)


if __name__ == "__main__":
    sys.exit(main())
