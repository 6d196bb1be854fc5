"""Two real pairs of scans, of the folder that ICPSHAP_REAL_DATA names, and games of a pair."""

import os
from pathlib import Path

import pandas as pd

from icpshap import estimators, plan
from icpshap.data.pair import Pair, describe_pair, relative_pose
from icpshap.data.poses import read_poses
from icpshap.data.scans import read_scan
from icpshap.estimators.perturb import Perturbation, Streams
from icpshap.explanation import games
from icpshap.explanation.scan_pair import ScanPair

SEED = 20260101
PERTURBATION = Perturbation()
PATHS = {
    "apartment": ("apartment_pair/csv_local/*.csv", "apartment_pair/leica/*.csv"),
    "spinning": ("spinning_pair/*.ply", "spinning_pair/poses.txt"),
}


def folder():
    """The folder with the real scans, or None."""
    named = os.environ.get("ICPSHAP_REAL_DATA")
    return Path(named) if named else None


def real_pair(name):
    """The `Pair` `apartment` (a tilting scanner) or `spinning` (32 rings)."""
    scans, poses = (sorted(folder().glob(pattern)) for pattern in PATHS[name])
    T = relative_pose(read_poses(poses[0], 2), 0, 1)
    return Pair.measured(*(read_scan(path)[0] for path in scans), T, PERTURBATION.overlap_distance)


class Game:
    """An instance (its levels by cause) of a pair by a preset: estimated once, read at will."""

    def __init__(self, name, pair, preset, levels, seed=SEED):
        self.preset, self.pair = preset, pair
        self.estimator = preset.estimator.of_causes(list(levels))
        self.off = {cause: self.estimator.causes[cause].off for cause in levels}
        self.levels = {cause: (level,) for cause, level in levels.items()}
        self.settings = plan.settings(self.levels, 1)
        self.streams = Streams(seed, name, 0, 1)
        row = describe_pair(
            pair,
            name,
            (0, 1),
            levels=(),
            minimum_overlap=PERTURBATION.minimum_overlap,
            minimum_range=self.estimator.perturbing.minimum_range,
        )
        self.scan_pair = ScanPair.of(next(pd.DataFrame([row]).itertuples()))

    def estimated(self, settings=None):
        """The tables of runs and of estimates of settings, by default of all."""
        settings = self.settings if settings is None else settings
        given = (self.estimator, PERTURBATION.deviation, self.streams)
        return estimators.estimate(self.pair, settings, *given)

    def explained(self, runs, estimates, method=None):
        """The `games.Explanation` of these tables."""
        instances = pd.DataFrame(plan.instances(self.levels), columns=list(self.levels))
        instances = instances.rename_axis("instance").reset_index()
        returns = self.estimator.returned
        given = (instances, self.off, returns, method or self.preset.method, self.scan_pair)
        return games.explain(runs, estimates, *given)
