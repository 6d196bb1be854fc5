"""What two overlapping clouds look like, in a few numbers that a covariance can be learned from.

After Landry, Pomerleau, Giguère, "CELLO-3D: Estimating the Covariance of ICP in the Real World"
(ICRA 2019): moments, histogram of normals, shapes and occupancy of the cells in which both clouds
have points. Everything is in the axes of the source, as the covariance is, and nothing is made
alike under rotation: corridors along x and along y have different covariances.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from icpshap import se3

CELL = 0.5  # m, edge of a cell
FEWEST_POINTS = 5  # of a cloud in a cell, from which they have a shape
FEWEST_CELLS = 3  # in which both clouds have points, one of them a shape: else no descriptor
QUARTILES = (0.25, 0.5, 0.75)
BITS = 21  # of a cell's coordinate in its key: 2,000 km
UPPER = np.triu_indices(3)
# A normal has no sign: of the 26 directions to the neighbours of a cell, one of each two.
DIRECTIONS = np.array([d for d in product((-1, 0, 1), repeat=3) if d > (0, 0, 0)], dtype=float)
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


class Cells(NamedTuple):
    """The c cells in which a cloud has points.

    key (c,): which cell, ascending; number (c,) of points; mean (c, 3) [m]; covariance (c, 3, 3)
    [m^2] of the points.
    """

    key: np.ndarray
    number: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, points):
        """Those of points (n, 3) [m]."""
        place = np.floor(points / CELL)
        shifted = place.astype(np.int64) + 2 ** (BITS - 1)
        keys = (shifted << (BITS * np.arange(3))).sum(axis=1)
        key, first, row = np.unique(keys, return_index=True, return_inverse=True)
        number = np.bincount(row)
        inside = points - place * CELL  # small, so that the squares lose nothing
        mean = _sums(row, inside) / number[:, None]
        about = inside - mean[row]
        products = about[:, :, None] * about[:, None, :]
        covariance = _sums(row, products.reshape(-1, 9)).reshape(-1, 3, 3) / number[:, None, None]
        return cls(key, number, mean + place[first] * CELL, covariance)

    def rows(self, chosen):
        """The same of some cells alone."""
        return Cells(*(part[chosen] for part in self))


def _sums(row, values):
    """Sums (c, k) of the values (n, k) of each cell; row (n,): the cells they belong to."""
    return np.stack([np.bincount(row, column) for column in values.T], axis=1)


def descriptor(reference, source, T_reference_source):
    """The descriptor (d,) of two clouds (n, 3) and (m, 3) [m]; None where they hardly overlap.

    Its entries are those of tables.DESCRIPTOR, in their order. That of the points changes them by
    round-off alone.
    """
    moved = se3.transform(se3.inverse(T_reference_source), reference)
    clouds = [Cells.of(cloud) for cloud in (source, moved)]
    keys = clouds[0].key, clouds[1].key
    _, *rows = np.intersect1d(*keys, assume_unique=True, return_indices=True)
    shared = [cells.rows(chosen) for cells, chosen in zip(clouds, rows, strict=True)]
    both = Cells(*map(np.concatenate, zip(*shared, strict=True)))
    shaped = both.rows(both.number >= FEWEST_POINTS)
    if min(len(shared[0].key), len(shaped.key)) < FEWEST_CELLS:
        return None
    return np.concatenate([_moments(shared[0]), _shapes(shaped), _occupancy(clouds, shared)])


def _moments(cells):
    """Mean (3) [m] and covariance (6) [m^2] of all points of cells."""
    weight = cells.number / cells.number.sum()
    mean = weight @ cells.mean
    about = cells.mean - mean
    second = cells.covariance + about[:, :, None] * about[:, None, :]
    return np.concatenate([mean, np.tensordot(weight, second, 1)[UPPER]])


def _shapes(cells):
    """Histogram of normals (13), mean shape (3) and quartiles of the thickness (3) [m] of cells.

    A point counts as its cell does. The shape is linear, planar and scattered, by the eigenvalues
    of the cell's covariance; the thickness is the root of the smallest one.
    """
    values, vectors = np.linalg.eigh(cells.covariance)
    values = np.maximum(values, 0.0)  # that of a perfect plane may be rounded below 0
    weight = cells.number / cells.number.sum()
    nearest = np.abs(vectors[:, :, 0] @ DIRECTIONS.T).argmax(axis=1)
    normals = np.bincount(nearest, weight, minlength=len(DIRECTIONS))
    low, middle, high = values.T
    shape = np.stack([high - middle, middle - low, low]) / np.maximum(high, 1e-300)
    thickness = np.sqrt(low)
    return np.concatenate([normals, shape @ weight, np.quantile(thickness, QUARTILES)])


def _occupancy(clouds, shared):
    """Log numbers of shared cells and of both clouds' points in them (3), and shares of these (2).

    clouds: the cells of both; shared: those that both have points in.
    """
    points = np.array([cells.number.sum() for cells in shared])
    of_all = np.array([cells.number.sum() for cells in clouds])
    return np.concatenate([[np.log(len(shared[0].key))], np.log(points), points / of_all])
