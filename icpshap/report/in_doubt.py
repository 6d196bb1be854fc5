"""The pairs of a drive that are most in doubt, as a table.

The fewest runs at the true pose come first, since f says nothing of where the runs end: one that
always misses has a small f. Tables are shap tables, and studies `study.Study`.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from tabulate import tabulate

from icpshap.report import words
from icpshap.report.study import Study
from icpshap.tables import PAIR

MOST = 10  # pairs that are listed; of few pairs half
SUCCESS = ["clean_success_rate", "success_rate"]
ERRORS = [f"{clean}{kind}_rmse" for kind in ("translation", "rotation") for clean in ("clean_", "")]
ESTIMATES = [f"{name}{end}" for name in ("wrong_basin_share", "f") for end in ("", "_low", "_high")]
# Which comes first, and whether it is the smaller value that does.
ORDER = {"success_rate": True, "translation_rmse": False, "f": False}
HOW = (
    "the fewest runs within 0.1 m and 2 degrees of the true pose with all causes on, of equal ones "
    "the largest translation error, or none since every run failed"
)
HOW_WITHOUT_RUNS = "the largest f"


def ranking(table: pd.DataFrame, study: Study) -> pd.DataFrame:
    """The pairs most in doubt, a row each from rank 1: a table with one row of each pair.

    What was not registered has no rank. largest: the cause with the largest part of f.
    """
    registered = table[table.reason == ""]
    found = registered[[*PAIR, *SUCCESS, *ERRORS, *ESTIMATES]].copy()
    if not study.returns.samples:  # nothing was run that could succeed or err
        found[[*SUCCESS, *ERRORS]] = np.nan
    found["largest"] = _largest(registered, study)
    # Where every run failed there is no error: none is worse.
    order = found[list(ORDER)].fillna({"translation_rmse": np.inf})
    order = order.sort_values(list(ORDER), ascending=list(ORDER.values()), kind="stable")
    found = found.loc[order.index]
    found = found.head(min(MOST, len(found) // 2))
    found.insert(0, "rank", np.arange(1, len(found) + 1))
    return found.reset_index(drop=True)


def how(study: Study) -> str:
    """By what pairs are ranked, in words."""
    return HOW if study.returns.samples else HOW_WITHOUT_RUNS


def read(path: str | Path) -> pd.DataFrame:
    """The table from the file that `DataFrame.to_csv` wrote."""
    table = pd.read_csv(path, dtype={"sequence": str, "largest": str}, keep_default_na=False)
    numbers = [name for name in table if name not in ("sequence", "largest")]
    return table.assign(**{name: pd.to_numeric(table[name]) for name in numbers})


def html(found: pd.DataFrame, study: Study) -> str:
    """A ranking as an HTML table."""
    rows = [
        [
            row.rank,
            study.pair(row),
            _change(row.clean_success_rate, row.success_rate, lambda share: f"{100 * share:.0f}"),
            _change(row.clean_translation_rmse, row.translation_rmse, words.centimetres),
            _change(row.clean_rotation_rmse, row.rotation_rmse, _degrees),
            _estimate(row, "wrong_basin_share"),
            _estimate(row, "f"),
            row.largest and words.titles([row.largest])[0],
        ]
        for row in found.itertuples()
    ]
    header = [
        "",
        "pair",
        "runs at the true pose [%]",
        "error [cm]",
        "error [deg]",
        "W",
        f"f [{study.unit}]",
        "largest part of f",
    ]
    return tabulate(rows, header, tablefmt="html", disable_numparse=True)


def _largest(table, study):
    """Names of the causes with the largest φ of each row; "" where none is above 0."""
    names = np.array([cause.name for cause in study.players])
    phi = table[[f"phi_{name}" for name in names]].fillna(0.0).to_numpy()
    if len(phi) == 0:
        return []
    return np.where(phi.max(axis=1) > 0, names[phi.argmax(axis=1)], "")


def _change(clean, on, told):
    """A number clean and with all causes on, "none" where every run failed; "" of neither."""
    if np.isnan(clean) and np.isnan(on):
        return ""
    return " → ".join("none" if np.isnan(value) else told(value) for value in (clean, on))


def _degrees(radians):
    return words.significant(np.rad2deg(radians))


def _estimate(row, name):
    value, low, high = (getattr(row, f"{name}{end}") for end in ("", "_low", "_high"))
    return "" if np.isnan(value) else words.with_interval(value, low, high)
