"""What a run was made with: configuration, versions, commit, host, times and licences of the data.

It goes beside the results, never into them: the same inputs give the same results anywhere.
"""

import os
import platform
import subprocess
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from math import isfinite
from pathlib import Path
from typing import Any

import pandas as pd

from icpshap.data.citation import NOTICE

PACKAGES = (
    "matplotlib",
    "numba",
    "numpy",
    "open3d",
    "pandas",
    "plotly",
    "pyarrow",
    "scipy",
    "shap",
    "snakemake",
)
LICENCES = {
    "archive": NOTICE,
    "folder": "files of the user, under the licence they came with",
    "simulated": "made by icpshap, MIT",
}


def provenance(
    config: Mapping[str, Any], sequences: Mapping[str, str], root: str | Path, logs: str | Path
) -> dict[str, Any]:
    """A mapping that YAML can hold.

    config: the effective configuration; sequences: key to kind (archive, folder or simulated) of
    the selected ones; root: folder of the code; logs: folder of the benchmark files of all rules.
    """
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(root),
        "python": platform.python_version(),
        "packages": packages(),
        "host": host(),
        "data": {key: LICENCES[kind] for key, kind in sequences.items()},
        "jobs": job_times(logs, {*config["run"], *sequences}).to_dict(orient="records"),
        "config": config,
    }


def packages() -> dict[str, str]:
    """Versions by name of the packages that decide numbers or pictures."""
    return {name: _version(name) for name in PACKAGES}


def commit(root: str | Path) -> str:
    """The commit that is checked out, '-dirty' after it if files differ; '' outside git."""
    described = subprocess.run(
        ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"],
        capture_output=True,
        text=True,
    )
    return described.stdout.strip()


def host() -> dict[str, Any]:
    """Processor, cores, memory [GB] and operating system."""
    processor = platform.processor() or platform.machine()
    for line in _lines("/proc/cpuinfo"):
        if line.startswith("model name"):
            processor = line.partition(":")[2].strip()
            break
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "processor": processor,
        "cores": os.cpu_count(),
        "memory_gb": round(memory / 1e9, 1),
        "system": platform.platform(),
    }


def job_times(logs: str | Path, names: Iterable[str]) -> pd.DataFrame:
    """A row per rule: jobs, and seconds in all and of the longest, of the last run of each job.

    names: experiments and sequences whose jobs count; jobs of neither are left out.
    """
    rows = []
    for folder in sorted(path for path in Path(logs).iterdir() if path.is_dir()):
        files = [
            path
            for path in sorted(folder.rglob("*.tsv"))
            if path.relative_to(folder).with_suffix("").parts[0] in names
        ]
        seconds = [known for file in files if (known := _seconds(file)) is not None]
        if seconds:
            rows.append(
                {
                    "rule": folder.name,
                    "jobs": len(seconds),
                    "seconds": round(sum(seconds), 1),
                    "longest": round(max(seconds), 1),
                }
            )
    return pd.DataFrame(rows, columns=["rule", "jobs", "seconds", "longest"])


def _seconds(file):
    """The seconds that a benchmark file tells; None if it is broken, as a kill leaves it."""
    try:
        found = float(pd.read_csv(file, sep="\t")["s"].iloc[0])
        return found if isfinite(found) else None
    except (ValueError, KeyError, IndexError, OSError):
        return None


def _version(package):
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _lines(path):
    return Path(path).read_text(encoding="utf-8").splitlines() if Path(path).exists() else []
