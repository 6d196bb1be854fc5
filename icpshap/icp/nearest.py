"""The nearest reference points of any points: the matching of a registration, on its own.

For estimators that linearise at a pose, or that move particles instead of whole runs.
"""

import numpy as np

from icpshap.icp.matching import match, measure, work_arrays
from icpshap.icp.reference import Reference, checked_points

QUERIES = 32_768  # are matched together: their arrays stay in the cache


class Matcher:
    """The `matches` nearest points of a Reference; keeps its arrays from call to call."""

    def __init__(self, reference: Reference, matches: int = 1) -> None:
        self.reference = reference
        self.matches = matches
        self._work = work_arrays(QUERIES, matches)

    def __call__(self, points: np.ndarray, limit: float = np.inf) -> tuple[np.ndarray, np.ndarray]:
        """Squared distances [m^2] and rows of the matches of points (m, 3) [m], reference frame.

        Both (m, matches), nearest first, the lowest row on ties. A link whose squared distance
        exceeds `limit` [m^2] has the row -1 and an infinite one. Raises ValueError for points that
        are not finite, and where the reference has fewer points than `matches`.
        """
        points = checked_points(points, "points to match") - self.reference.mean
        lists, work = self.reference.lists(self.matches), self._work
        distance = np.empty((len(points), self.matches))
        found = np.empty((len(points), self.matches), np.int32)
        for first in range(0, len(points), QUERIES):
            part = slice(first, first + QUERIES)
            count = len(points[part])
            work.x[:count], work.y[:count], work.z[:count] = points[part].T
            match(lists, limit, count, work)
            links = found[part].reshape(-1), distance[part].reshape(-1)
            measure(lists, limit, count, work, *links)
        return distance, np.where(found >= 0, lists.tree.rows[found], -1)
