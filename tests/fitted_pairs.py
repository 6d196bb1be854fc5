"""Pairs of scans as scanners see them, and how options fit them: rows of the fit tables."""

import numpy as np
import pandas as pd

from icpshap import se3
from icpshap.data.pair import Pair
from icpshap.estimators.perturb import Streams
from icpshap.fit import checks
from icpshap.fit.measure import measure
from icpshap.presets import PAPER

LEVELS = {"sensor_noise": 0.05, "initial_pose": 1.5, "partial_overlap": 0.05}
STREAMS = Streams(1, "room", 0, 1)


def numbers(pair, preset=PAPER, levels=LEVELS):
    return measure(pair, preset.estimator.of_causes(list(levels)), levels, STREAMS)


def fit(pair, preset=PAPER, levels=LEVELS):
    row = {"sequence": "room", "reference": 0, "source": 1, **numbers(pair, preset, levels)}
    return checks.table(pd.DataFrame([row])).set_index("check")


def rings(count, columns, noise=0.0, position=(0.0, 0.0, 0.0)):
    """Points of a room of 10 m as a scanner in it sees it by rings; noise along the beams."""
    generator = np.random.default_rng(1)
    elevation = np.deg2rad(np.linspace(-22, 22, count))[:, None]
    azimuth = np.linspace(0, 2 * np.pi, columns, endpoint=False)
    parts = np.broadcast_arrays(
        np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    )
    directions = np.stack(parts, axis=-1).reshape(-1, 3)
    with np.errstate(divide="ignore", invalid="ignore"):  # of walls along the beam
        to_walls = (5.0 * np.sign(directions) - position) / directions
    ranges = np.nanmin(to_walls, axis=1) + noise * generator.normal(size=len(directions))
    return ranges[:, None] * directions


def ring_pair(count, columns, motion):
    """Two turns of a scanner that moved by so much [m] along x."""
    source = rings(count, columns, 0.02, (motion, 0.0, 0.0))
    T_reference_source = se3.exp([0, 0, 0, motion, 0, 0])
    return Pair.measured(rings(count, columns, 0.02), source, T_reference_source, 0.2)


def corner_pair(near, far, density, motion=(0, 0, 0, 0.1, 0, 0)):
    """Two scans of three walls that meet in a corner, as a scanner at the origin sees them.

    near, far (3,): ends of the walls, of which wall k is where axis k is far; density: points a
    square metre; motion (6,): xi of T_reference_source.
    """
    T_reference_source = se3.exp(motion)
    reference, source = (_corner(near, far, density, seed) for seed in (1, 2))
    source = se3.transform(se3.inverse(T_reference_source), source)
    return Pair.measured(reference, source, T_reference_source, 0.2)


def _corner(near, far, density, seed):
    generator = np.random.default_rng(seed)
    near, far = np.array(near), np.array(far)
    walls = []
    for axis in range(3):
        area = np.abs(np.delete(far - near, axis)).prod()
        points = near + generator.random((round(density * area), 3)) * (far - near)
        points[:, axis] = far[axis]
        walls.append(points)
    return np.concatenate(walls)
