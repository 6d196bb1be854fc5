"""Normals: by the neighbours they say, against plain numpy."""

import numpy as np
import pytest

from icpshap import icp


def expected(points, neighbours, radius):
    """Unit normals from the nearest neighbours, and from all within the radius."""
    result = []
    for point in points:
        distance = np.linalg.norm(points - point, axis=1)
        order = np.argsort(distance, kind="stable")
        number = max(neighbours, np.count_nonzero(distance <= radius))
        around = points[order[:number]]
        _, vectors = np.linalg.eigh(np.cov(around.T))
        result.append(vectors[:, 0])
    return np.array(result)


@pytest.mark.parametrize("radius", [None, 0.05, 0.3, 1.0])
def test_neighbours_are_the_nearest_and_all_within_the_radius(radius):
    rng = np.random.default_rng(0)
    points = rng.random((400, 3)) * [2, 2, 0.2]
    reference = icp.Reference(points, 7, radius)
    normals = reference.in_rows(reference.normals)
    along = np.abs(np.einsum("na,na->n", normals, expected(points, 7, radius or 0.0)))
    np.testing.assert_allclose(along, 1.0, atol=1e-9)


def test_coincident_points_within_the_radius_all_count():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.random((60, 3)) * [1, 1, 0.1], np.full((40, 3), 0.5)])
    reference = icp.Reference(points, 7, 0.6)
    normals = reference.in_rows(reference.normals)
    along = np.abs(np.einsum("na,na->n", normals, expected(points, 7, 0.6)))
    np.testing.assert_allclose(along, 1.0, atol=1e-9)
