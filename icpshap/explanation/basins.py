"""Runs that end in a wrong basin: marked when runs are read, so that no limit registers again."""

import warnings

import numpy as np


def wrong_basin(xi, translation, rotation):
    """Runs further than translation [m] or rotation [rad] from their setting's median pose.

    xi (..., n, 6) to bool (..., n). The median is taken component by component over the runs that
    did not fail; a failed run (NaN) is no wrong basin.
    """
    xi = np.asarray(xi, dtype=float)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice", RuntimeWarning)
        median = np.nanmedian(xi, axis=-2, keepdims=True)
    away = xi - median
    far = np.linalg.norm(away[..., :3], axis=-1) > rotation
    return far | (np.linalg.norm(away[..., 3:], axis=-1) > translation)
