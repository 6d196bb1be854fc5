"""Do other processors compute other numbers, and how far apart?

    python -m benchmarks.processors [--keep FOLDER]

Runs the small workflow of the faults from nothing, as this machine does it, and again with
libraries that are told of another processor: OpenBLAS with the kernels of 2004, compiled code for
any x86-64, NumPy without AVX2 and AVX-512, the C library's functions without AVX2 and FMA. Prints
for each of them, and each kind of table, how many tables have another number and the largest
difference of a number, relative to the largest of its column. The last line is JSON. It takes five
minutes.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.faults.workplace import TABLES, Workplace

OTHERS = {
    "OpenBLAS for Prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "compiled code for any x86-64": {"NUMBA_CPU_NAME": "generic"},
    "NumPy without AVX2 and AVX-512": {
        "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"
    },
    "C library without AVX2 and FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA"},
}


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--keep", type=Path, help="a folder to work in, which stays")
    arguments = parser.parse_args()
    found = []
    print("| processor | table | differ | of | relative difference | column |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(prefix="processors_") as folder:
        folder = arguments.keep or Path(folder)
        this = ran(folder / "this")
        for number, (name, variables) in enumerate(OTHERS.items()):
            for row in compared(this, ran(folder / str(number), variables)):
                found.append({"processor": name, **row})
                print(f"| {' | '.join(map(str, found[-1].values()))} |", flush=True)
    print(json.dumps(found))


def ran(folder, variables=None):
    """A workplace whose tables are all made, by processes with these variables."""
    place = Workplace.new(folder)
    code, said = place.run("--", *TABLES, **(variables or {}))
    if code != 0:
        raise RuntimeError(f"The workflow failed with {variables}:\n{said}")
    return place


def compared(this, other):
    """A row for each kind of table: how many differ, of how many, and the largest difference."""
    kinds = {}
    for path in sorted(this.bytes()):
        kinds.setdefault(kind(path), []).append(path)
    for name, paths in kinds.items():
        found = [max(differences(path, this, other), default=(0.0, "")) for path in paths]
        relative, column = max(found)
        yield {
            "table": name,
            "differ": sum(one[0] > 0 for one in found),
            "of": len(paths),
            "relative": float(f"{relative:.1e}"),
            "column": column if relative else "",
        }


def kind(path):
    """runs, shap, ...: the folder or the file that tables of a kind share a name of."""
    path = Path(path)
    return path.parent.name if path.stem[0].isdigit() else path.stem.rstrip("0123456789_")


def differences(path, this, other):
    """(largest difference relative to the largest value, name) of the columns of numbers."""
    one, two = (pd.read_parquet(place.folder / path) for place in (this, other))
    columns = one.select_dtypes("number").columns
    if not one.drop(columns=columns).equals(two.drop(columns=columns)):
        raise RuntimeError(f"{path}: other words or another order of rows")
    for name in columns:
        yield difference(one[name].to_numpy(float), two[name].to_numpy(float)), name


def difference(one, two):
    finite = np.isfinite(one)
    if (finite != np.isfinite(two)).any():
        return np.inf
    if not finite.any():
        return 0.0
    return float(np.abs(one - two)[finite].max() / (np.abs(one[finite]).max() or 1.0))


if __name__ == "__main__":
    main()
