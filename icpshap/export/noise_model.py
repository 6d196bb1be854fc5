"""A noise model of a registration by coalition of causes, a row each, to paste into SLAM code."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from icpshap.causes import CAUSES, named
from icpshap.export.format import Format
from icpshap.report import words
from icpshap.tables import covariance_columns

if TYPE_CHECKING:
    from icpshap.export.measurement import Measurement


BELOW = """\
Square roots of the diagonal of the mean covariance over the pairs, of xi in T_reference_source
exp(xi), rotation first, in the frame of the source: `gtsam.noiseModel.Diagonal.Sigmas` takes the
last column. The whole covariances: `--to csv`.
"""


class Markdown(Format):
    name = "markdown"
    meaning = "the noise model by coalition of causes, a table to paste"
    all_coalitions = True

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        table = noise_model(measurements)
        shown = pd.DataFrame(
            {
                "causes": [_in_words(levels) for levels in table["levels"]],
                "pairs": table["pairs"],
                "rotation x y z [deg]": [_plain(np.rad2deg(s[:3])) for s in table["sigmas"]],
                "translation x y z [cm]": [_plain(100 * s[3:]) for s in table["sigmas"]],
                "sigmas [rad, m]": [f"`[{_exact(s)}]`" for s in table["sigmas"]],
            }
        )
        return {"": f"{shown.to_markdown(index=False, disable_numparse=True)}\n\n{BELOW}"}


class Csv(Format):
    name = "csv"
    meaning = "the same with the whole covariances, upper triangles row by row"
    all_coalitions = True

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        rows = [
            {**row.levels, "pairs": row.pairs, **covariance_columns(row.covariance)}
            for row in noise_model(measurements).itertuples()
        ]
        return {"": pd.DataFrame(rows).to_csv(index=False, lineterminator="\n")}


def noise_model(measurements: Sequence[Measurement]) -> pd.DataFrame:
    """A row a coalition, the fewest causes first: levels, pairs, covariance (6, 6), sigmas (6,).

    The covariance is the mean over the pairs: that of an error of any of them, about the mean of
    its own pair.
    """
    by_levels: dict[tuple, list[np.ndarray]] = {}
    for one in measurements:
        by_levels.setdefault(tuple(one.levels.items()), []).append(one.covariance)
    rows = []
    for levels, found in sorted(by_levels.items(), key=lambda item: len(_on(dict(item[0])))):
        covariance = np.mean(found, axis=0)
        rows.append(
            {
                "levels": dict(levels),
                "pairs": len(found),
                "covariance": covariance,
                "sigmas": np.sqrt(np.diagonal(covariance)),
            }
        )
    return pd.DataFrame(rows)


def _on(levels):
    return {name: level for name, level in levels.items() if level != CAUSES[name].off}


def _in_words(levels):
    on = _on(levels)
    return words.describe_values(on, named(on)) or "none"


def _plain(values):
    return " ".join(words.significant(value) for value in values)


def _exact(values):
    return ", ".join(f"{value:.4g}" for value in values)
