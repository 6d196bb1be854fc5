"""Exact ICP, thousands of runs on one reference at a time.

    reference = icp.Reference(points)
    result = icp.register(reference, source, rows, T_initial, icp.Chain())

`chain` names the parts, `registration` is the loop; the other modules are one idea each.
How fast it is, and why: docs/engine.md.
"""

from icpshap.icp.batches import numbered
from icpshap.icp.chain import Chain, Stopping, Trimmed
from icpshap.icp.minimisers import PointToPlane, PointToPoint
from icpshap.icp.nearest import Matcher
from icpshap.icp.reference import Reference, minimum_range
from icpshap.icp.registration import STATUS, Registrations, register

__all__ = [
    "STATUS",
    "Chain",
    "Matcher",
    "PointToPlane",
    "PointToPoint",
    "Reference",
    "Registrations",
    "Stopping",
    "Trimmed",
    "minimum_range",
    "numbered",
    "register",
]
