"""The reference cloud with all that its registrations share: centre, k-d tree, normals, lists.

Everything is made when first needed and kept, so one Reference serves every call of `register`
with the same reference points: all initial poses, overlap levels and runs of one noise level.
"""

import functools

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.candidates import Lists, empty_lists, forget, nearly_full
from icpshap.icp.compiled import announce_compilation
from icpshap.icp.normals import planes

LARGEST_COORDINATE = 1e30  # m; the squares of products still fit


def minimum_range(points: np.ndarray, minimum: float) -> np.ndarray:
    """Mask (n,) of the points (n, 3) farther than `minimum` [m] from their frame's origin."""
    return np.linalg.norm(points, axis=1) > minimum


def checked_points(points: np.ndarray, what: str) -> np.ndarray:
    """`points` as a float64 array (n, 3), n >= 1.

    Raises ValueError if it is not, or not finite, or so large that its squares overflow.
    """
    points = np.ascontiguousarray(points, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise ValueError(f"{what}: expected points of shape (n, 3), n >= 1; got {points.shape}.")
    if not np.isfinite(points).all():
        finite = np.isfinite(points).all(axis=1)
        raise ValueError(
            f"{what}: {np.count_nonzero(~finite)} of {len(points)} points are not finite, the "
            f"first in row {np.argmin(finite)}. Hint: drop these rows before registration."
        )
    farthest = max(points.max(), -points.min())
    if farthest > LARGEST_COORDINATE:
        raise ValueError(
            f"{what}: a coordinate of {farthest:.3g} m, expected at most {LARGEST_COORDINATE:.0e}. "
            "Hint: is the file read with the right columns and units?"
        )
    return points


class Reference:
    """A reference cloud to register against.

    points: (n, 3) [m] in the reference frame, after any range filter. ValueError unless finite.
    normal_neighbours: neighbours of a point, itself included, that give its normal; normal_radius
    [m]: with all others within it, or None for no others.
    """

    def __init__(
        self, points: np.ndarray, normal_neighbours: int = 7, normal_radius: float | None = None
    ) -> None:
        points = checked_points(points, "reference cloud")
        self.normal_neighbours = normal_neighbours
        self.normal_radius = normal_radius or 0.0
        self.mean = points.mean(axis=0)
        self._size = len(points)
        self._centred = points - self.mean
        self._lists: dict[int, Lists] = {}

    def __len__(self) -> int:
        return self._size

    @functools.cached_property
    def tree(self) -> kdtree.Tree:
        """k-d tree of the points minus their mean."""
        announce_compilation(kdtree.build)
        tree = kdtree.build(self._centred)
        del self._centred  # the tree holds them
        return tree

    @property
    def planes(self) -> np.ndarray:
        """Unit normal, normal . point [m] (n, 4) in the tree's order. ValueError if n is too small.

        The sign of a normal is arbitrary.
        """
        return self._tangent_planes[:-1]

    @property
    def normals(self) -> np.ndarray:
        """Unit normals (n, 3) in the tree's order."""
        return self.planes[:, :3]

    def in_rows(self, values: np.ndarray) -> np.ndarray:
        """Values (n, ...) in the tree's order, in the order of the points that were given."""
        result = np.empty_like(values)
        result[self.tree.rows] = values
        return result

    def surface(self, with_normals: bool) -> np.ndarray:
        """What the features of a link to a point need, in the tree's order, and a row of zeros.

        (n + 1, 4): the tangent plane or, without normals, x, y, z, 1. Rows of 32 bytes: half a
        cache line.
        """
        return self._tangent_planes if with_normals else self._homogeneous_points

    @functools.cached_property
    def _tangent_planes(self):
        if len(self) < self.normal_neighbours:
            raise ValueError(
                f"Normals from {self.normal_neighbours} neighbours need as many reference points; "
                f"there are {len(self)}. Hint: use point-to-point ICP or fewer normal_neighbours."
            )
        return planes(self.tree, self.normal_neighbours, self.normal_radius)

    @functools.cached_property
    def _homogeneous_points(self):
        surface = np.pad(self.tree.points, [(0, 1), (0, 0)])
        surface[:-1, 3] = 1.0
        return surface

    def lists(self, matches: int) -> Lists:
        """The candidate lists for that many matches, which fill as they are used.

        Raises ValueError if there are fewer points.
        """
        if len(self) < matches:
            raise ValueError(
                f"{matches} matches a point need as many reference points; there are {len(self)}. "
                "Hint: a larger cloud or fewer matches."
            )
        if matches not in self._lists:
            self._lists[matches] = empty_lists(self.tree, matches)
        if nearly_full(self._lists[matches]):
            forget(self._lists[matches])
        return self._lists[matches]
