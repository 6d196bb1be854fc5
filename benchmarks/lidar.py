"""How the preset `lidar` was chosen: success, f and its stability, on ring scanners.

    python -m benchmarks.lidar [variants] [stability] [--quick]

variants: of chains on the real spinning pair (of the folder that ICPSHAP_REAL_DATA names) and on
simulated spinning scanners indoors and outdoors: share of neighbourhoods on one ring, success of
the clean setting, of that with sensor noise alone and of that with all causes on, f and Shapley
value of the sensor noise, CPU seconds. stability: f of `lidar` with 25 % more and fewer normal
neighbours, a voxel side 25 % longer and shorter, and another seed. The last line is JSON.
"""

import argparse
import json

import numpy as np
from tabulate import tabulate

from benchmarks import real_pairs
from benchmarks.icp import Clock
from icpshap.data import simulate
from icpshap.data.pair import Pair, relative_pose
from icpshap.estimators.kind import GOOD_STATUS
from icpshap.estimators.perturb import Streams
from icpshap.fit import measure
from icpshap.presets import LIDAR, PAPER, ROBUST
from icpshap.tables import XI

INSTANCE = {"sensor_noise": 0.02, "initial_pose": 1.5, "partial_overlap": 0.05}
SCANNERS = {16: 28_800, 32: 57_600, 64: 65_536, 128: 131_072}  # rings: beams
SCENES = {"indoors": "apartment", "outdoors": "plain"}
VARIANTS = {
    "paper": PAPER,
    "robust": ROBUST,
    "lidar": LIDAR,
    "lidar, 7 neighbours": LIDAR.with_options(normal_neighbours=7),
    "lidar, no voxel": LIDAR.with_options(voxel_size=None, subsampling_probability=0.1),
}


def simulated_pair(scene, rings, speed=0.0):
    """Two consecutive turns of a simulated spinning scanner."""
    T = simulate.simulate_poses(scene, 2, seed=1)
    scanner = {"rings": rings, "speed": speed}
    clouds = [
        simulate.simulate_scan(scene, k, T[k], SCANNERS[rings], 1, **scanner) for k in range(2)
    ]
    distance = real_pairs.PERTURBATION.overlap_distance
    return Pair.measured(*clouds, relative_pose(T, 0, 1), distance)


def pairs(quick):
    found = {"spinning, real": real_pairs.real_pair("spinning")} if real_pairs.folder() else {}
    for where, scene in SCENES.items():
        for rings in (16,) if quick else SCANNERS:
            found[f"{where}, {rings} rings"] = simulated_pair(scene, rings)
    if not quick:
        found["outdoors, 64 rings, 1.5 m/s"] = simulated_pair("plain", 64, 1.5)
    return found


def ring_share(pair, preset):
    """Share of the neighbourhoods of the clean reference's normals that lie on one ring."""
    estimator = preset.estimator.of_causes(list(INSTANCE))
    streams = Streams(real_pairs.SEED, "rings", 0, 1)
    return measure.measure(pair, estimator, INSTANCE, streams)["ring_share"]


def explained(name, pair, preset, seed=real_pairs.SEED):
    """The explanation, and success of runs that are clean, with noise alone and with all causes."""
    game = real_pairs.Game(name, pair, preset, INSTANCE, seed)
    runs, estimates = game.estimated()
    found = game.explained(runs, estimates)
    success = []
    for on in ((), ("sensor_noise",), tuple(INSTANCE)):
        rows = runs[runs["again"] == False]  # noqa: E712
        for cause, level in INSTANCE.items():
            rows = rows[rows[cause] == (level if cause in on else game.off[cause])]
        xi = rows[XI].to_numpy()
        far = np.linalg.norm(xi[:, :3], axis=1) > np.deg2rad(2)
        far |= np.linalg.norm(xi[:, 3:], axis=1) > 0.1
        success.append(np.mean(~far & rows["status"].isin(GOOD_STATUS)))
    return found.shap.iloc[0], success


def interval(row, name):
    return f"{row[name]:.2f} [{row[name + '_low']:.2f}, {row[name + '_high']:.2f}]"


def variants(quick):
    lines, figures = [], []
    for name, pair in pairs(quick).items():
        for variant, preset in VARIANTS.items():
            with Clock() as clock:
                row, success = explained(name, pair, preset)
            values = [interval(row, column) for column in ("f", "phi_sensor_noise")]
            shares = [ring_share(pair, preset), *success]
            lines.append([name, variant, *(f"{s:.2f}" for s in shares), *values])
            lines[-1].append(f"{clock.seconds:.1f}")
            figures.append([name, variant, *shares, float(row["f"]), round(clock.seconds, 2)])
            print(" | ".join(lines[-1]), flush=True)
    header = ["pair", "chain", "rings", "clean", "noise", "all", "f", "phi sensor noise", "CPU s"]
    print(tabulate(lines, header, "pipe", disable_numparse=True), "\n")
    return {"variants": figures}


def stability(quick):
    neighbours, side = LIDAR.options["normal_neighbours"], LIDAR.options["voxel_size"]
    changes = {"as it is": {}}
    for factor in (0.75, 1.25):
        changes[f"{round(factor * neighbours)} neighbours"] = {
            "normal_neighbours": round(factor * neighbours)
        }
        changes[f"{factor * side:.3g} m voxels"] = {"voxel_size": factor * side}
    lines, figures = [], []
    for name, pair in pairs(quick).items():
        found = {
            change: explained(name, pair, LIDAR.with_options(**options))[0]
            for change, options in changes.items()
        }
        found["another seed"] = explained(name, pair, LIDAR, real_pairs.SEED + 1)[0]
        of = found["as it is"]
        for change, row in found.items():
            lines.append([name, change, interval(row, "f"), f"{row['f'] / of['f'] - 1:+.0%}"])
            figures.append([name, change, float(row["f"])])
            print(" | ".join(lines[-1]), flush=True)
    header = ["pair", "change", "f", "difference"]
    print(tabulate(lines, header, "pipe", disable_numparse=True), "\n")
    return {"stability": figures}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["variants", "stability"])
    parser.add_argument("--quick", action="store_true", help="few pairs, to try the program")
    given = parser.parse_args()
    figures = {}
    if "variants" in given.parts:
        figures |= variants(given.quick)
    if "stability" in given.parts:
        figures |= stability(given.quick)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
