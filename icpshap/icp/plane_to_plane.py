"""The linearised error of generalised ICP: both points of a link lie on planes of their own.

Segal, Haehnel, Thrun, "Generalized-ICP" (RSS 2009). A point has the covariance 1 m^2 in its tangent
plane and `FLATNESS` of that along its normal n: C = I - (1 - FLATNESS) n n^T. A link from s to q at
the pose (R, t) weighs M = (C_q + R C_s R^T)^-1.

Idea: in the frame of the source, with u the sum and v the difference of the two unit normals, the
sum of both covariances has the eigenvectors u, v and what is orthogonal to them, so that its
inverse is I/2 + a u u^T + b v v^T: no matrix is inverted, and H is a sum of outer products.

Exactness: the eigenvalues come from |u|^2 and |v|^2, which lose nothing where normals agree.
"""

import numpy as np

from icpshap.icp.compiled import Array, jit

FLATNESS = 1e-3


@jit
def linearise(
    source: tuple[Array, Array], reference: tuple[Array, Array], found: Array, T: Array
) -> tuple[Array, Array, float, float, int]:
    """Sums over the links from the source's points to rows `found` (m,) of the reference.

    source, reference: points [m] and their unit normals, both (m, 3) or (n, 3), in a frame of their
    own; found: -1 where there is no link; T (4, 4). With r = q - T s in the source frame, and
    B = [-[s]x, I] for steps xi in T exp(xi), rotation first: the sums of B^T M B (6, 6),
    B^T M r (6,), r^T M r and r^T r [m^2], and the number of links.
    """
    points, normals = source
    reference_points, reference_normals = reference
    matrix, gradient = np.zeros((6, 6)), np.zeros(6)
    weighted = squared = 0.0
    links = 0
    u, v, r = np.empty(6), np.empty(6), np.empty(6)
    for i in range(points.shape[0]):
        j = found[i]
        if j < 0:
            continue
        links += 1
        s = points[i]
        uu = vv = ur = vr = rr = 0.0
        for axis in range(3):
            moved = normal = 0.0
            for k in range(3):
                moved += T[k, axis] * (reference_points[j, k] - T[k, 3])
                normal += T[k, axis] * reference_normals[j, k]
            u[3 + axis] = normal + normals[i, axis]
            v[3 + axis] = normal - normals[i, axis]
            r[3 + axis] = moved - s[axis]
            uu += u[3 + axis] * u[3 + axis]
            vv += v[3 + axis] * v[3 + axis]
            ur += u[3 + axis] * r[3 + axis]
            vr += v[3 + axis] * r[3 + axis]
            rr += r[3 + axis] * r[3 + axis]
        a = 0.5 * (1.0 - FLATNESS) / (vv + FLATNESS * uu)
        b = 0.5 * (1.0 - FLATNESS) / (uu + FLATNESS * vv)
        _turn(s, u)
        _turn(s, v)
        _turn(s, r)
        for row in range(6):
            gradient[row] += 0.5 * r[row] + a * ur * u[row] + b * vr * v[row]
            au, bv = a * u[row], b * v[row]
            for column in range(row, 6):
                matrix[row, column] += au * u[column] + bv * v[column]
        _add_half_of_moments(s, matrix)
        weighted += 0.5 * rr + a * ur * ur + b * vr * vr
        squared += rr
    for row in range(6):
        for column in range(row):
            matrix[row, column] = matrix[column, row]
    return matrix, gradient, weighted, squared, links


@jit
def _turn(s, d):
    """B^T d of the point s: the cross product s x d[3:] into d[:3]."""
    d[0] = s[1] * d[5] - s[2] * d[4]
    d[1] = s[2] * d[3] - s[0] * d[5]
    d[2] = s[0] * d[4] - s[1] * d[3]


@jit
def _add_half_of_moments(s, matrix):
    """Add the upper triangle of B^T B / 2 of the point s."""
    x, y, z = 0.5 * s[0], 0.5 * s[1], 0.5 * s[2]
    matrix[0, 0] += y * s[1] + z * s[2]
    matrix[1, 1] += x * s[0] + z * s[2]
    matrix[2, 2] += x * s[0] + y * s[1]
    matrix[0, 1] -= x * s[1]
    matrix[0, 2] -= x * s[2]
    matrix[1, 2] -= y * s[2]
    matrix[0, 4] -= z
    matrix[0, 5] += y
    matrix[1, 3] += z
    matrix[1, 5] -= x
    matrix[2, 3] -= y
    matrix[2, 4] += x
    for axis in range(3, 6):
        matrix[axis, axis] += 0.5
