"""Sums over source points for `stein_newton`, compiled."""

import numpy as np

from icpshap.icp.compiled import jit


@jit
def normal_equations(rotation, source, error, squared, limit):
    """Hessian (k, 6, 6) and gradient (k, 6) of k particles, translation first.

    rotation (k, 3, 3); source (n, 3) [m]; error (k, n, 3) [m]: moved source point minus its match;
    squared (k, n) [m^2]: its square, infinite without a match; limit [m^2]: see `stein_newton`.
    """
    particles, points = squared.shape
    hessian = np.zeros((particles, 6, 6))
    gradient = np.zeros((particles, 6))
    back = np.empty(3)
    for k in range(particles):
        H, g, R = hessian[k], gradient[k], rotation[k]
        weights = 0.0
        for i in range(points):
            if not squared[k, i] < limit:
                # As released: a link that is rejected stays as a point at the origin that is
                # matched to itself, of weight 1, and holds the translation back.
                weights += 1.0
                continue
            weight = (limit / (limit + 3 * np.sqrt(squared[k, i]))) ** 2
            weights += weight
            x, y, z = source[i]
            for a in range(3):
                back[a] = weight * (
                    R[0, a] * error[k, i, 0] + R[1, a] * error[k, i, 1] + R[2, a] * error[k, i, 2]
                )
                g[a] += back[a]
            g[3] += y * back[2] - z * back[1]
            g[4] += z * back[0] - x * back[2]
            g[5] += x * back[1] - y * back[0]
            # -[s]x and -[s]x [s]x
            H[0, 4] += weight * z
            H[0, 5] -= weight * y
            H[1, 5] += weight * x
            H[3, 3] += weight * (y * y + z * z)
            H[4, 4] += weight * (x * x + z * z)
            H[5, 5] += weight * (x * x + y * y)
            H[3, 4] -= weight * x * y
            H[3, 5] -= weight * x * z
            H[4, 5] -= weight * y * z
        H[1, 3], H[2, 3], H[2, 4] = -H[0, 4], -H[0, 5], -H[1, 5]
        for a in range(3):
            H[a, a] = weights
        for a in range(6):
            for b in range(a):
                H[a, b] = H[b, a]
    return hessian, gradient
