"""From a pair of scans and settings to ICP pose samples: the table of runs.

A setting perturbs the raw scans, the chain filters them, and ICP runs from drawn initial poses.
Settings with the same sensor noise share the perturbed reference, so its search index and normals
are built once for each noise level and noise draw, and runs that share them go to ICP together.
"""

from collections import defaultdict
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from icpshap import icp, se3
from icpshap.causes import NAMES
from icpshap.estimators import perturb as perturbation
from icpshap.explanation.readings import GOOD_STATUS, wrong_basin
from icpshap.plan import Setting
from icpshap.tables import INITIAL_XI, TRANSFORM, XI

RUNS_AT_ONCE = 1200  # runs that go through the search index together; more only cost memory


class Start(NamedTuple):
    """The runs of a setting before ICP: source points (m, 3) [m], rows and initial pose of each."""

    setting: Setting
    source: np.ndarray
    rows: list
    initial_xi: np.ndarray
    T_initial: np.ndarray


def register_settings(pair, settings, registration, perturbation_settings, streams):
    """Run ICP for every run of every setting: the runs table, in the order of the settings.

    pair: perturbation.Pair; settings: list of plan.Setting; registration: parameters.Registration;
    perturbation_settings: parameters.Perturbation; streams: perturbation.Streams of the pair.
    Raises perturbation.PerturbationError if a setting cannot be applied to the pair.
    """
    chain = chain_of(registration)
    deviation = initial_pose_deviation(perturbation_settings)
    tables = defaultdict(list)
    for (branch, sigma), level in _grouped(
        settings, lambda s: (_branch(s, registration), s.values[0])
    ):
        sampler = Sampler(
            pair, registration, perturbation_settings.overlap_distance, streams.branched(branch)
        )
        for noise_draw, runs in enumerate(
            np.split(np.arange(registration.runs), registration.noise_draws)
        ):
            reference, once_noisy, source = sampler.noisy_clouds(sigma, noise_draw)
            in_range = icp.minimum_range(reference, registration.minimum_range)
            target = icp.Reference(reference[in_range], registration.normal_neighbours)
            starts = _starts(sampler, level, once_noisy, source, runs, deviation)
            for batch in _batches(starts, max(1, RUNS_AT_ONCE // len(runs))):
                rows = [run for start in batch for run in start.rows]
                T_initial = np.concatenate([start.T_initial for start in batch])
                result = icp.register(target, batch[0].source, rows, T_initial, chain)
                for k, start in enumerate(batch):
                    part = slice(k * len(runs), (k + 1) * len(runs))
                    frame = _runs_frame(pair, start, runs, noise_draw, result, part)
                    tables[start.setting].append(frame)
    return pd.concat(
        [mark_wrong_basins(pd.concat(tables[setting]), registration) for setting in settings]
    )


def _starts(sampler, level, reference, source, runs, deviation):
    """The `runs` of each setting of a noise level before ICP, one setting after the other.

    reference, source: the noisy clouds (n, 3), (m, 3) [m]; deviation: of xi at s = 1 (6,).
    """
    registration = sampler.registration
    T_reference_source = sampler.pair.T_reference_source
    for reduction, members in _grouped(level, lambda s: s.values[2]):
        left, kept = sampler.reduce_overlap(reference, source, reduction)
        usable = kept & icp.minimum_range(left, registration.minimum_range)
        rows = sampler.rows(usable, runs)
        for setting in members:
            xi, T_initial = perturbation.initial_poses(
                T_reference_source,
                setting.values[1],
                sampler.initial_pose_draws[runs],
                deviation,
                registration.initial_pose_scaling,
                registration.initial_pose_composition,
            )
            yield Start(setting, left, rows, xi, T_initial)


def chain_of(registration):
    """The ICP chain that a registration's configuration describes."""
    metrics = {"point_to_plane": icp.PointToPlane, "point_to_point": icp.PointToPoint}
    return icp.Chain(
        error_minimiser=metrics[registration.metric](),
        matches=registration.matches,
        outlier_filter=icp.Trimmed(registration.kept_links),
        maximum_distance=registration.maximum_distance,
        stopping=icp.Stopping(
            registration.maximum_iterations,
            registration.stop_rotation,
            registration.stop_translation,
        ),
    )


def initial_pose_deviation(perturbation_settings):
    """Standard deviation of xi (6,) at s = 1 [rad, m]: the square root of Sigma's diagonal."""
    rotation = np.deg2rad(perturbation_settings.initial_pose_rotation)
    return np.repeat([rotation, perturbation_settings.initial_pose_translation], 3) / np.sqrt(3)


class Sampler:
    """The random draws of a pair, which every setting of one branch of the streams shares."""

    def __init__(self, pair, registration, overlap_distance, streams):
        self.pair = pair
        self.registration = registration
        self.overlap_distance = overlap_distance
        self.streams = streams
        self.subsample = cache(self._subsample)

    @cached_property
    def initial_pose_draws(self):
        """Standard normal (runs, 6); what run r draws does not depend on the number of runs."""
        return self.streams.generator("initial_pose").standard_normal((self.registration.runs, 6))

    @cached_property
    def overlap_order(self):
        generator = self.streams.generator("overlap")
        return perturbation.overlap_order(self.pair.overlapping, generator)

    def noisy_clouds(self, sigma, noise_draw):
        """The reference that ICP sees, the reference that overlap is measured on, and the source.

        The two references differ only where the noise is added to the reference twice.
        """
        if sigma == 0:
            return self.pair.reference, self.pair.reference, self.pair.source
        reference = self._noisy(self.pair.reference, sigma, f"noise/reference/{noise_draw}")
        source = self._noisy(self.pair.source, sigma, f"noise/source/{noise_draw}")
        if self.registration.reference_noise_additions == 1:
            return reference, reference, source
        twice = self._noisy(reference, sigma, f"noise/reference_again/{noise_draw}")
        return twice, reference, source

    def _noisy(self, points, sigma, name):
        return points + sigma * self.streams.generator(name).standard_normal(points.shape)

    def reduce_overlap(self, reference, source, reduction):
        """Source points (m, 3) after a reduction of the overlap, and a mask (m,) of those left."""
        if self.registration.overlap_removal == "noisy":
            source = perturbation.set_overlap(
                self.pair,
                reference,
                source,
                reduction,
                self.overlap_distance,
                self.streams.generator("overlap"),
            )
            return source, np.ones(len(source), dtype=bool)
        return source, perturbation.reduce_overlap(self.pair, reduction, self.overlap_order)

    def rows(self, usable, runs):
        """Source rows of each run: its subsample of the usable ones (m,), ascending.

        Runs with the same subsample get the same array.
        """
        if self.registration.subsampling_mask == "frozen_in_order":
            usable = np.flatnonzero(usable).astype(np.int32)
            return [usable[self.subsample(len(usable), 0)]] * len(runs)
        takes_all = self.registration.subsampling_probability == 1
        if self.registration.subsampling_mask == "frozen" or takes_all:
            return [self._usable_rows(usable, 0)] * len(runs)
        return [self._usable_rows(usable, run) for run in runs]

    def _usable_rows(self, usable, mask):
        drawn = self.subsample(len(usable), mask)
        return drawn[usable[drawn]]

    def _subsample(self, count, mask):
        generator = self.streams.generator(f"subsample/{mask}")
        probability = self.registration.subsampling_probability
        return perturbation.subsample(count, probability, generator).astype(np.int32)


def _branch(setting, registration):
    """Name of the set of draws that a setting uses; settings with one name share every draw."""
    branch = f"replicate/{setting.replicate}/" if setting.replicate else ""
    if setting.again:
        branch += "again/"
    if not registration.common_random_numbers:
        branch += f"setting/{setting.values}/"
    return branch


def _grouped(items, key):
    """Items by key, keys in the order of their first item."""
    groups = defaultdict(list)
    for item in items:
        groups[key(item)].append(item)
    return groups.items()


def _batches(starts, size):
    """Consecutive starts with the same source points, at most `size` at once.

    Made as they are asked for: the rows of all settings together may not fit into memory.
    """
    batch = []
    for start in starts:
        if batch and (len(batch) == size or start.source is not batch[0].source):
            yield batch
            batch = []
        batch.append(start)
    if batch:
        yield batch


def _runs_frame(pair, start, runs, noise_draw, result, part):
    T_reference_source = result.T_reference_source[part]
    error = se3.log(se3.inverse(pair.T_reference_source) @ T_reference_source)
    return pd.DataFrame(
        {
            **dict(zip(NAMES, start.setting.values, strict=True)),
            "replicate": np.int32(start.setting.replicate),
            "draws": np.int32(start.setting.again),
            "run": runs.astype(np.int32),
            "noise_draw": np.int32(noise_draw),
            **dict(zip(INITIAL_XI, start.initial_xi.T, strict=True)),
            **dict(zip(XI, error.T, strict=True)),
            **dict(zip(TRANSFORM, T_reference_source.reshape(-1, 16).T, strict=True)),
            "iterations": result.iterations[part].astype(np.int32),
            "status": result.status[part],
            "rmse": result.rmse[part],
            "inlier_ratio": result.inlier_ratio[part],
        }
    )


def mark_wrong_basins(runs, registration):
    """The runs of a setting with the column wrong_basin; a failed run is in none."""
    converged = runs["status"].isin(GOOD_STATUS).to_numpy()
    marks = wrong_basin(
        np.where(converged[:, None], runs[XI].to_numpy(), np.nan),
        translation=registration.wrong_basin_translation,
        rotation=np.deg2rad(registration.wrong_basin_rotation),
    )
    return runs.assign(wrong_basin=marks)
