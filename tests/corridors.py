"""Pairs of a corridor along x, in which little holds a motion along it."""

import numpy as np

from icpshap import se3
from icpshap.data.pair import Pair
from icpshap.estimators.perturb import Streams

SIDE, HEIGHT, LENGTH = 2.0, 1.5, 8.0  # m, half of each


def pair(seed=0, points=6000, noise=0.005, turn=0.0):
    """A pair whose source is turned about z and moved by 0.3 m along x."""
    T = se3.exp(np.array([0, 0, turn, 0.3, 0, 0]))
    reference, source = (cloud(2 * seed + k, points, noise) for k in range(2))
    source = se3.transform(se3.inverse(T), source)
    return Pair.measured(reference, source, T, 0.2)


def cloud(seed, points, noise):
    generator = np.random.default_rng(seed)
    found = generator.uniform(-1, 1, (points, 3)) * [LENGTH, SIDE, HEIGHT]
    surface = generator.choice(5, points, p=[0.285, 0.285, 0.205, 0.205, 0.02])
    axis = np.array([1, 1, 2, 2, 0])[surface]
    side = np.array([1, -1, 1, -1, 1])[surface]
    found[np.arange(points), axis] = side * np.array([LENGTH, SIDE, HEIGHT])[axis]
    return found + generator.normal(0, noise, found.shape)


def streams(place=0):
    return Streams(1, "corridor", place, place + 1)
