"""The cases of the attribution benchmark, and how many of them have an effect.

    python -m benchmarks.attribution [--seed 20261130] [--scenes corridor street] [--every 1]

Pairs of simulated scans are degraded (`injector`), and what each part does to ICP is measured
(`effects`): the labels that an explanation must find. Printed are the cases and those with effect
by cause, scene and scanner; the last line is JSON.
"""

import argparse
import json
from collections import Counter

from tabulate import tabulate

from benchmarks.attribution import injector
from benchmarks.attribution.effects import effects


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=injector.FIRST_SEED)
    parser.add_argument("--scenes", nargs="+", default=injector.SCENES, choices=injector.SCENES)
    parser.add_argument("--every", type=int, default=1, help="only every so many cases")
    given = parser.parse_args()
    sequences = [
        injector.sequence(scene, scanner, given.seed)
        for scene in given.scenes
        for scanner in injector.SCANNERS
    ]
    groups = {
        "single": injector.single_cases(sequences, given.seed),
        "unknown": injector.unknown_cases(sequences, given.seed),
        "mixture": injector.mixtures(sequences, given.seed),
    }
    number, effective = Counter(), Counter()
    for group, cases in groups.items():
        for case in cases[:: given.every]:
            found = effects(case)
            of = case.sequence
            parts = " + ".join(case.parts) if group != "mixture" else "mixture"
            for key in ((group, parts), (group, of.scene), (group, of.scanner)):
                number[key] += 1
                effective[key] += found.first is not None
            told = ", ".join(f"{part} {drop:+.2f}" for part, drop in found.drops.items())
            print(f"{of.scene} {of.scanner} {case.pair}: V {found.value:.2f}; {told}", flush=True)
    rows = [[*key, number[key], effective[key]] for key in number]
    print(tabulate(rows, ["group", "of", "cases", "with effect"], "pipe"))
    print(json.dumps({" ".join(key): [number[key], effective[key]] for key in number}))


if __name__ == "__main__":
    main()
