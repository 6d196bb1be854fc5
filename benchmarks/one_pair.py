"""Seconds that a person waits for the explanation of one pair, as whole processes.

    python -m benchmarks.one_pair [--repeat 3]

On the real pairs of the folder that ICPSHAP_REAL_DATA names: `icpshap explain` of the spinning and
of the Apartment pair, with a full and with an empty compilation cache, what a variant of --what-if
adds, `icpshap fit`, the import, and what a user would write instead: 900 calls of small_gicp and of
Open3D on the same clouds. Wall seconds of the fastest repetition; the last line is JSON.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import real_pairs

CALLS = """
import sys, numpy as np
from icpshap import registrations, se3
names = ("reference", "source", "T")
reference, source, T = (np.load(f"{sys.argv[2]}/{name}.npy") for name in names)
deviation = np.repeat([np.deg2rad(10.0), 0.2], 3) / np.sqrt(3)
generator = np.random.default_rng(0)
register = getattr(registrations, sys.argv[1])
for start in se3.exp(generator.standard_normal((int(sys.argv[3]), 6)) * deviation):
    half = source[generator.random(len(source)) < 0.5]
    register(reference, half, T @ start)
"""
COMPARED = 90  # calls that are timed, of the 900 that an explanation has


def seconds(command, repeat=1, **environment):
    """Wall seconds of the fastest of some repetitions of a process."""
    found = []
    for _ in range(repeat):
        begun = time.perf_counter()
        subprocess.run(
            command,
            check=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **environment},
        )
        found.append(time.perf_counter() - begun)
    return min(found)


def write(folder, name):
    """The real pair as files; the arguments of the command."""
    pair = real_pairs.real_pair(name)
    place = Path(folder) / name
    place.mkdir()
    for part in ("reference", "source"):
        np.save(place / f"{part}.npy", getattr(pair, part))
    np.save(place / "T.npy", pair.T_reference_source)
    np.savetxt(place / "T.txt", pair.T_reference_source)
    return [
        *(str(place / f"{part}.npy") for part in ("reference", "source")),
        *("--transform", str(place / "T.txt")),
    ]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=3)
    repeat = parser.parse_args().repeat
    command = [sys.executable, "-m", "icpshap"]
    figures = {}

    def told(name, value):
        figures[name] = round(value, 2)
        print(f"{name:<32} {value:8.2f} s", flush=True)

    with TemporaryDirectory() as folder:
        spinning, apartment = (write(folder, name) for name in ("spinning", "apartment"))
        cache = {"NUMBA_CACHE_DIR": f"{folder}/cache"}
        explain = [*command, "explain", *spinning]
        told("spinning_first_call_seconds", seconds(explain, **cache))
        told("spinning_seconds", seconds(explain, repeat, **cache))
        variant = [*explain, "--what-if", "more:normal_neighbours=30"]
        told("variant_seconds", seconds(variant, repeat, **cache) - figures["spinning_seconds"])
        told("fit_seconds", seconds([*command, "fit", *spinning], repeat, **cache))
        told("apartment_seconds", seconds([*command, "explain", *apartment], repeat, **cache))
        lean = [sys.executable, "-c", "import icpshap"]
        told("import_seconds", seconds(lean, repeat))
        for name in ("small_gicp", "open3d"):
            calls = [sys.executable, "-c", CALLS, name, f"{folder}/spinning"]
            some, none = (seconds([*calls, str(number)]) for number in (COMPARED, 1))
            told(f"{name}_900_seconds", 900 * (some - none) / (COMPARED - 1) + none)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
