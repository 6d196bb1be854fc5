"""Small pieces of text: numbers, intervals, perturbations, and what an axis is like."""

import numpy as np

from icpshap.causes import named

# Values beyond this, which a few runs in a wrong basin can cause, get a logarithmic axis.
HUGE = 1000


def number(value):
    """A value as text, with two decimals unless it is very large."""
    return f"{value:.2f}" if abs(value) < 1000 else f"{value:.3g}"


def interval(low, high):
    """An interval as text, "" where there is none."""
    return "" if np.isnan(low) or np.isnan(high) else f"[{number(low)}, {number(high)}]"


def with_interval(value, low, high):
    """A value and, where there is one, its interval."""
    return f"{number(value)} {interval(low, high)}".strip()


def is_huge(values):
    """Whether some of the values (...) are so large that the others would vanish beside them."""
    return bool((np.abs(np.asarray(values, dtype=float)) > HUGE).any())


def axis(values):
    """What an axis for such values is like, where it is not plain."""
    return " The axis is linear up to 1 and logarithmic beyond." * is_huge(values)


def level(cause, value):
    """A cause's value in symbols, as in 'σ = 0.05 m'."""
    return f"{cause.symbol} = {value:g} {cause.unit}".strip()


def describe_values(values, causes):
    """One perturbation in symbols, as in 'σ = 0.05 m, s = 1.5, λ = 0.05'; causes: classes."""
    return ", ".join(level(cause, values[cause.name]) for cause in causes)


def titles(names):
    """The titles of causes by their names, in the order of the names."""
    return [named([name])[0].title for name in names]


def listed(parts):
    """Parts of a sentence, as in 'a, b and c'; "" where there are none."""
    if not parts:
        return ""
    *first, last = parts
    return f"{', '.join(first)} and {last}" if first else last
