"""Small pieces of text: numbers, intervals, perturbations, and what an axis is like."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from icpshap.causes import named

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.causes.cause import Cause


# Values beyond this, which a few runs in a wrong basin can cause, get a logarithmic axis.
HUGE = 1000
SPREAD = 20  # times the median, from which a pair hides the others on a linear axis
AXIS = " The axis is linear up to 1 and logarithmic beyond."


def number(value: float) -> str:
    """A value as text, with two decimals, or three digits where it is large."""
    if abs(value) < 1000:
        return f"{value:z.2f}"  # z: no -0.00
    return f"{float(f'{value:.3g}'):.0f}" if abs(value) < 1e5 else f"{value:.3g}"


def interval(low: float, high: float) -> str:
    """An interval as text, "" where there is none."""
    return "" if np.isnan(low) or np.isnan(high) else f"[{number(low)}, {number(high)}]"


def with_interval(value: float, low: float, high: float) -> str:
    """A value and, where there is one, its interval.

    >>> with_interval(1.234, 1.0, 2.5)
    '1.23 [1.00, 2.50]'
    """
    return f"{number(value)} {interval(low, high)}".strip()


def is_huge(values: np.ndarray) -> bool:
    """Whether some of the values (...) are so large that the others would vanish beside them."""
    return bool((np.abs(np.asarray(values, dtype=float)) > HUGE).any())


def axis(values: np.ndarray) -> str:
    """What an axis for such values (...) is like, where it is not plain."""
    return AXIS * is_huge(values)


def is_spread(table: pd.DataFrame) -> bool:
    """Whether a value in a column of a table is so far above the others that it would hide them."""
    sizes = table.abs()
    return bool((sizes.max() > SPREAD * np.maximum(sizes.median(), 1.0)).any())


def level(cause: Cause | type[Cause], value: float) -> str:
    """A cause's value in symbols, as in 'σ = 0.05 m'."""
    return f"{cause.symbol} = {value:g} {cause.unit}".strip()


def describe_values(
    values: Mapping[str, float] | pd.Series, causes: Iterable[Cause | type[Cause]]
) -> str:
    """One perturbation in words, as in 'sensor noise σ = 0.05 m, partial overlap λ = 0.05'."""
    return ", ".join(f"{cause.title} {level(cause, values[cause.name])}" for cause in causes)


def titles(names: Iterable[str]) -> list[str]:
    """The titles of causes by their names, in the order of the names."""
    return [named([name])[0].title for name in names]


def listed(parts: Sequence[str]) -> str:
    """Parts of a sentence, as in 'a, b and c'; "" where there are none.

    >>> listed(["a", "b", "c"])
    'a, b and c'
    """
    if not parts:
        return ""
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last


def significant(value: float) -> str:
    """A value as text, with two significant digits and no exponent unless it is far from 1.

    >>> significant(0.01234), significant(1234.5)
    ('0.012', '1234')
    """
    if np.isinf(value):
        return "∞"
    if value == 0 or 1e-4 <= abs(value) < 10:
        return f"{value:.2g}"
    return f"{value:.0f}" if 10 <= abs(value) < 1e5 else f"{value:.1e}"


def centimetres(metres: float) -> str:
    """A length [m] in cm, with two significant digits."""
    return significant(100 * metres)


def of_rows(table: pd.DataFrame, name: str, unit: str = "") -> str:
    """A number of the rows of a table: of one row with its interval, of several the median.

    unit: stands behind it; with "%" a share is told in per cent.
    """
    text = cell(table, name, unit)
    several = table[name].notna().sum() > 1
    return f"{text} in the median" if several else text


def cell(table: pd.DataFrame, name: str, unit: str = "") -> str:
    """As `of_rows`, for a table that says whether its numbers are medians."""
    factor = 100 if unit == "%" else 1
    rows = factor * table[[name, f"{name}_low", f"{name}_high"]].dropna(subset=name)
    unit = f" {unit}" if unit else ""
    if len(rows) == 0:
        return "no value"
    if len(rows) == 1:
        return f"{with_interval(*rows.iloc[0])}{unit}"
    return f"{number(rows[name].median())}{unit}"
