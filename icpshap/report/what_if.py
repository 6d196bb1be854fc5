"""What the explained instance becomes with other options, as a table, and which of them helps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from tabulate import tabulate

from icpshap.report import words
from icpshap.report.study import PAIR, pairs_of

if TYPE_CHECKING:
    from icpshap.report.study import Study


AS_IT_IS = "as it is"
HELPS = 0.9  # times the error, below which a change is said to lower it
ERRORS = {
    "clean_translation_rmse": "m",
    "clean_rotation_rmse": "rad",
    "translation_rmse": "m",
    "rotation_rmse": "rad",
}
SHARES = ("f", "f_low", "f_high", "wrong_basin_share", "success_rate")


def table(
    parts: Iterable[tuple[str, Mapping[str, Any], pd.DataFrame]], pairs: pd.DataFrame
) -> pd.DataFrame:
    """A row for each change and pair: what it is, errors, f, share of wrong basins, success.

    parts: (name, changes, shap table of the instance) of each, the first as it is; pairs: the pairs
    table, for the length at which a rotation counts.
    """
    rows = [
        shap[[*PAIR, *ERRORS, *SHARES]].assign(what_if=name, changes=in_words(changes))
        for name, changes, shap in parts
    ]
    joined = pd.concat(rows, ignore_index=True)
    joined = joined.merge(pairs[[*PAIR, "characteristic_length"]], how="left")
    return joined[["what_if", "changes", *PAIR, "characteristic_length", *ERRORS, *SHARES]]


def in_words(changes: Mapping[str, Any]) -> str:
    """Changes as one writes them, as in 'normal_neighbours: 20'."""
    return ", ".join(f"{name}: {_written(value)}" for name, value in changes.items())


def _written(value):
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def medians(table: pd.DataFrame) -> pd.DataFrame:
    """A row of each change, in their order: medians over pairs, and the error at the length L.

    error [m]: sqrt(translation^2 + (L rotation)^2) of the perturbed runs.
    """
    error = np.hypot(table.translation_rmse, table.characteristic_length * table.rotation_rmse)
    numbers = [*ERRORS, *SHARES, "error"]
    grouped = table.assign(error=error).groupby(["what_if", "changes"], sort=False)[numbers]
    return grouped.median().reset_index()


def now_and_best(table: pd.DataFrame) -> tuple[pd.Series, pd.Series | None]:
    """Rows of `medians`: as it is, and what of all that was tried lowers the error most.

    None in the place of the second where nothing lowers it by a tenth.
    """
    rows = medians(table)
    now, tried = rows.iloc[0], rows.iloc[1:]
    better = tried[tried.error < HELPS * now.error]
    return now, None if better.empty else better.loc[better.error.idxmin()]


def advice(table: pd.DataFrame, study: Study) -> str:
    """What of all that was tried helps most, with its effect; or that nothing does."""
    now, best = now_and_best(table)
    if np.isnan(now.error):
        return "What was tried returns no pose samples, and so no error to lower."
    several = ", in the median over pairs" * (len(pairs_of(table)) > 1)
    if best is None:
        tried = medians(table).what_if[1:]
        names = words.listed([name.replace("_", " ") for name in tried])
        return (
            f"Nothing that was tried ({names}) lowers the error with all causes by a tenth{several}"
            ": the data must change, not the options."
        )
    return (
        f"Of what was tried, {best.what_if.replace('_', ' ')} ({best.changes}) helps most"
        f"{several}: the error with all causes falls from {error(now)} to {error(best)}, f changes "
        f"from {words.number(now.f)} to {words.number(best.f)} {study.unit}."
    )


def error(row: Any, clean: bool = False) -> str:
    """The error of a row of `medians` in words, as in '17.8 cm, 2.5 deg'."""
    translation, rotation = (
        row[f"{'clean_' * clean}{name}"] for name in ("translation_rmse", "rotation_rmse")
    )
    if np.isnan(translation):
        return "no samples"
    return f"{words.centimetres(translation)} cm, {words.significant(np.rad2deg(rotation))} deg"


def html(table: pd.DataFrame, study: Study) -> str:
    """The medians of the changes as an HTML table."""
    return tabulate(_cells(table), _header(study), tablefmt="html", disable_numparse=True)


def markdown(table: pd.DataFrame, study: Study) -> str:
    """The same as Markdown, with the advice."""
    text = tabulate(_cells(table), _header(study), tablefmt="pipe", disable_numparse=True)
    return f"{text}\n\n{advice(table, study)}\n"


def _header(study):
    return ["", "changes", "error clean", "with all causes", f"f [{study.unit}]", "wrong basins"]


def _cells(table):
    one = len(pairs_of(table)) == 1
    for _, row in medians(table).iterrows():
        ends = (row.f_low, row.f_high) if one else (np.nan, np.nan)
        share = "no value" if np.isnan(row.wrong_basin_share) else f"{row.wrong_basin_share:.0%}"
        yield [
            row.what_if.replace("_", " "),
            row.changes,
            error(row, clean=True),
            error(row),
            words.with_interval(row.f, *ends),
            share,
        ]


def read(path: str | Path) -> pd.DataFrame:
    """The table of a CSV file."""
    return pd.read_csv(path, keep_default_na=False, na_values=[""]).fillna({"changes": ""})
