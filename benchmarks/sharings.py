"""The same game shared out in three ways: Shapley values, Banzhaf values and LIME's regression.

    python -m benchmarks.sharings SEQUENCE_FOLDER...

of folders results/{experiment}/{sequence}: a Markdown table of the last instance of the first pair.
"""

import sys
from pathlib import Path

import pandas as pd
from tabulate import tabulate

from icpshap import tables
from icpshap.causes import named
from icpshap.explanation import shapley, sharings

SHARINGS = {
    "Shapley": shapley.shapley_values,
    "Banzhaf": sharings.banzhaf_values,
    "LIME": sharings.lime_weights,
}


def game_of(folder):
    """Causes, instance and values (2^M,) of the last instance of the first pair of a sequence."""
    causes = named(tables.read_about(folder / "shap.parquet")["causes"])
    names, off = [c.name for c in causes], [c.off for c in causes]
    shap = tables.read(folder / "shap.parquet", "shap")
    of_first = shap.source == shap.source.iloc[0]
    row = shap[of_first & (shap.reference == shap.reference.iloc[0])].iloc[-1]
    settings = tables.read(folder / "uncertainty.parquet", "uncertainty")
    of_pair = (settings.reference == row.reference) & (settings.source == row.source)
    settings = settings[of_pair & ~settings.again & (settings.replicate == 0)]
    f = settings.set_index(pd.MultiIndex.from_frame(settings[names])).f
    coalitions = shapley.coalition_values(row[names].to_numpy(dtype=float), off)
    return causes, row, f.loc[list(map(tuple, coalitions))].to_numpy()


def table(folder):
    causes, row, game = game_of(folder)
    lines = []
    for name, share in SHARINGS.items():
        values = share(game)
        adds = f"{values.sum():.2f} of {game[-1] - game[0]:.2f}"
        lines.append([name, *(f"{value:.2f}" for value in values), adds])
    header = ["sharing", *(f"{c.title}, {row[c.name]:g} {c.unit}".strip() for c in causes), "sum"]
    return tabulate(lines, header, tablefmt="pipe", disable_numparse=True)


if __name__ == "__main__":
    for argument in sys.argv[1:]:
        print(f"\n{argument}\n\n{table(Path(argument))}")
