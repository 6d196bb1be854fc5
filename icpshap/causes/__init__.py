"""The causes of uncertainty, by name: one file each, found by being in this folder.

How a cause acts is in `cause`; how they act together is in icpshap/estimators/perturb.py.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from icpshap import options, registry
from icpshap.causes.cause import Cause

MOST = 7  # players of one experiment: each doubles the settings of an instance

CAUSES = registry.classes(__name__, __path__, Cause)


def named(names: Iterable[str]) -> tuple[type[Cause], ...]:
    """The causes of these names, in their own order. Raises KeyError for another name.

    >>> [cause.label() for cause in players(["partial_overlap", "sensor_noise"], {})]
    ['sensor noise σ [m]', 'partial overlap λ']
    """
    return tuple(sorted((CAUSES[name] for name in names), key=lambda c: (c.order, c.name)))


CAUSES = {cause.name: cause for cause in named(CAUSES)}


def players(names: Iterable[str], variants: Mapping[str, Mapping[str, Any]]) -> tuple[Cause, ...]:
    """The causes of these names with their words, in their own order.

    variants: options of those that are a variant, by name of the cause; see `variants_of`.
    """
    return tuple(cause(**variants.get(cause.name, {})) for cause in named(names))


def variants_of(causes: Mapping[str, Cause]) -> dict[str, dict[str, Any]]:
    """Of causes by name, the options of those that are a variant: what tables and words need."""
    found = {name: options.variant(cause) for name, cause in causes.items()}
    return {name: values for name, values in found.items() if values}


def shown() -> list[str]:
    """The names of the causes that a pair of scans shows.

    >>> shown()
    ['sensor_noise', 'partial_overlap', 'under_constrained']
    """
    return [name for name, cause in CAUSES.items() if cause.shown_by]
