"""Points and poses that tests write into files and read back."""

import numpy as np

from icpshap import se3

POINTS = np.random.default_rng(1).normal(0, 5, (1200, 3))
POSES = se3.exp(np.random.default_rng(2).normal(0, 0.5, (4, 6)))


def written(path, text):
    path.write_text(text, encoding="utf-8")
    return path
