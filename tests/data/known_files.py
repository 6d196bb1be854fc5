"""Points and poses that tests write into files and read back."""

import numpy as np

from icpshap import se3

POINTS = np.random.default_rng(1).normal(0, 5, (1200, 3))
POSES = se3.exp(np.random.default_rng(2).normal(0, 0.5, (4, 6)))


def walls_of(size, number, generator):
    """Points (number, 3) [m] on the six walls of a box of that size (3,) at the origin."""
    points = generator.uniform(0, size, (number, 3))
    axis = generator.integers(0, 3, number)
    points[np.arange(number), axis] = generator.integers(0, 2, number) * size[axis]
    return points


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path
