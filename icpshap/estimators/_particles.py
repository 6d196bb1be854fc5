"""Kernels between particles, as Stein variational methods use them."""

import numpy as np


def differences(particles):
    """Differences x_i - x_j (k, k, d) of particles (k, d), and their squared lengths (k, k)."""
    difference = particles[:, None] - particles
    return difference, np.square(difference).sum(axis=-1)


def lower_median(values):
    """The median of all values, the lower of the middle two: that of torch, as released."""
    middle = (values.size - 1) // 2
    return np.partition(values.ravel(), middle)[middle]
