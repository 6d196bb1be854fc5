"""Wrong basins of real pairs, and what they do to f: the tables of docs/uncertainty.md.

    ICPSHAP_REAL_DATA=FOLDER python -m benchmarks.basins

One instance, {0.05 m, 1.5, 0.05}, of the tilting scanner with chains whose clean spread has other
reasons, wrong basins kept and left out; then how many runs of each setting are marked, and whether
it has a basin, on both scanners and with normals of few and of more neighbours.
"""

from dataclasses import replace

from tabulate import tabulate

from benchmarks.real_pairs import Game, real_pair
from icpshap.presets import PAPER

LEVELS = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
QUARTER = PAPER.with_options(subsampling_probability=0.25)
ALL = PAPER.with_options(subsampling_probability=1.0)
CHAINS = {
    "planes, mask redrawn": QUARTER,
    "planes, every point": ALL,
    "points, every point": ALL.with_options(metric="point_to_point"),
}
SCANNERS = {
    "tilting, 7 neighbours": ("apartment", QUARTER),
    "spinning, 7 neighbours": ("spinning", PAPER.with_options(minimum_range=2.0)),
    "spinning, 20 neighbours": (
        "spinning",
        PAPER.with_options(minimum_range=2.0, normal_neighbours=20),
    ),
}


def with_ends(row, name, digits=2):
    value, low, high = (f"{row[name + end]:.{digits}f}" for end in ("", "_low", "_high"))
    return f"{value} [{low}, {high}]"


def of_chains():
    """f and phi with wrong basins kept and left out, and what the clean covariance is."""
    pair, lines = real_pair("apartment"), []
    for title, preset in CHAINS.items():
        game = Game("apartment", pair, preset, LEVELS)
        tables = game.estimated()
        for rule in ("keep", "leave_out"):
            found = game.explained(*tables, replace(preset.method, wrong_basins=rule))
            row, clean = found.shap.iloc[0], found.uncertainty.iloc[0]
            numbers = [with_ends(row, name) for name in ("f", *(f"phi_{c}" for c in LEVELS))]
            doubts = f"{clean['condition']:,.0f}", f"{clean['memory']:.2f}"
            lines.append([title, rule.replace("_", " "), row["n_used"], *numbers, *doubts])
    header = ["chain", "wrong basins", "runs", "f", *(f"phi {c.replace('_', ' ')}" for c in LEVELS)]
    return tabulate(lines, [*header, "condition", "memory"], "pipe", disable_numparse=True)


def of_scanners():
    """Runs of 100 that are marked in each setting."""
    lines = []
    for title, (name, preset) in SCANNERS.items():
        pair = real_pair(name)
        for noise in (0.02, 0.05):
            game = Game(name, pair, preset, {**LEVELS, "sensor_noise": noise})
            settings = game.explained(*game.estimated()).uncertainty
            settings = settings[~settings["again"]]
            marked = zip(settings["n_wrong_basin"], settings["no_basin"], strict=True)
            counts = ["none" if lacking else str(number) for number, lacking in marked]
            lines.append([title, f"{noise:g} m", *counts])
    on = settings[list(LEVELS)].ne(settings[list(LEVELS)].iloc[0]).astype(int)
    header = ["scanner", "noise", *("".join(map(str, row)) for row in on.to_numpy())]
    return tabulate(lines, header, "pipe", disable_numparse=True)


if __name__ == "__main__":
    print(of_chains(), of_scanners(), sep="\n\n")
