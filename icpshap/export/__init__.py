"""Covariances for other programs: one file a format; to add one is to add a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from icpshap import registry
from icpshap.causes import CAUSES
from icpshap.errors import UserError
from icpshap.export import measurement
from icpshap.export.format import Format

if TYPE_CHECKING:
    import pandas as pd


FORMATS = registry.classes(__name__, __path__, Format)


def export(
    table: pd.DataFrame, name: str, levels: Mapping[str, float], sequence: str | None = None
) -> tuple[dict[str, str], list[str]]:
    """A covariances table in the format of that name: texts, and remarks on what is not in them.

    texts: by what the name of the file has before its suffix, "" of the first; levels: of causes
    that the table has several of, or that shall be off, by name; sequence: its key, None for all
    that are there. Raises UserError.
    """
    written_as = FORMATS[name]()
    measured = measurement.of_sequence(measurement.measurements(table), sequence)
    if not measured:
        raise UserError(
            "The table has no rows, and so no covariance.\n"
            "Hint: an experiment without pairs makes one; give that of another."
        )
    chosen = measurement.instance(measured, levels)
    choose = measurement.coalitions if written_as.all_coalitions else measurement.at
    wanted = choose(measured, chosen)
    known = [one for one in wanted if one.is_known]
    if not known:
        raise UserError(
            f"{len(wanted)} measurement(s), none of which has a covariance: too few runs are left, "
            "or the pair was not registered.\n"
            "Hint: column `reason` and `n_used` of the table, and `warning` of uncertainty.parquet."
        )
    return written_as.texts(known), _remarks(wanted, known)


def _remarks(wanted, known):
    """What is left out: pairs without a covariance, and runs that a covariance is not of."""
    lines = []
    if lost := list(dict.fromkeys(one.in_words for one in wanted if not one.is_known)):
        lines.append(
            f"{len(lost)} pair(s) without a covariance are left out, the first is {lost[0]}."
        )
    worst = max(known, key=lambda one: one.left_out)
    if worst.left_out > 0:
        lines.append(
            f"The covariances leave out up to {worst.left_out:.0%} of the runs "
            f"({worst.in_words}), which failed or ended in a wrong basin."
        )
    return lines


def clean() -> dict[str, float]:
    """The levels of no perturbation at all, for `export`."""
    return {name: cause.off for name, cause in CAUSES.items()}
