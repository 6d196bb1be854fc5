"""The causes of uncertainty, by name: one file each, found by being in this folder.

How a cause acts is in `cause`; how they act together is in icpshap/estimators/perturb.py.
"""

from icpshap import registry
from icpshap.causes.cause import Cause

MOST = 7  # players of one experiment: each doubles the settings of an instance

CAUSES = registry.classes(__name__, __path__, Cause)


def named(names):
    """The causes of these names, in their own order. Raises KeyError for another name."""
    return tuple(sorted((CAUSES[name] for name in names), key=lambda c: (c.order, c.name)))


CAUSES = {cause.name: cause for cause in named(CAUSES)}
