"""The seam between perturbing and estimating: settings of a pair become clouds, rows and starts.

Causes act on the raw scans; the ICP chain filters afterwards (range filter, then subsampling).
Every random number comes from a named stream of its own, and the same draws serve every setting of
a pair (common random numbers): noise is sigma times one standard normal draw, xi is sqrt(s) times
one draw, masks are drawn on the rows of the raw scan, so that a removed point shifts no other.

Settings whose causes do the same to the reference share it, and whatever an estimator builds on it:
they come as one `Group` for each noise draw.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple
from zlib import crc32

import numpy as np

from icpshap import se3
from icpshap.causes.cause import HOOKS
from icpshap.data.pair import Pair
from icpshap.errors import PerturbationError
from icpshap.geometry import nearest_to_cell_centres
from icpshap.options import option
from icpshap.plan import Setting

if TYPE_CHECKING:
    from icpshap.estimators import Estimator


FEWEST_POINTS = 50  # of the source, and of the reference, that a run needs


@dataclass(frozen=True)
class Perturbation:
    """What the causes refer to, for every experiment."""

    initial_pose_rotation: float = option(
        10.0,
        "Root of the summed rotation variances of the initial pose at s = 1",
        unit="deg",
        above=0,
        maximum=180,
    )
    initial_pose_translation: float = option(
        0.2,
        "Root of the summed translation variances of the initial pose at s = 1",
        unit="m",
        above=0,
        maximum=1e4,
    )
    overlap_distance: float = option(
        0.2,
        "A source point overlaps when a reference point is at most this far away at the true pose",
        unit="m",
        above=0,
        maximum=1e4,
    )
    minimum_overlap: float = option(
        0.1,
        "Pairs whose overlap ratio is not larger than this are listed, not registered",
        unit="-",
        minimum=0,
        maximum=1,
    )

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of xi (6,) at s = 1 [rad x3, m x3]: root of Eq. 4's diagonal."""
        rotation = np.deg2rad(self.initial_pose_rotation)
        return np.repeat([rotation, self.initial_pose_translation], 3) / np.sqrt(3)


@dataclass(frozen=True)
class Perturbing:
    """How a pair is perturbed and filtered, whatever estimates its pose: options of every kind."""

    minimum_range: float = option(
        1.0,
        "Points of both clouds nearer to their scanner than this are removed",
        unit="m",
        minimum=0,
        maximum=1e5,
    )
    voxel_size: float | None = option(
        None,
        "Of the points of both clouds in a cell of a voxel grid of this side, one is kept, the "
        "nearest to its centre before anything moves; null keeps all",
        unit="m",
        above=0,
        maximum=1e4,
    )
    subsampling_probability: float = option(
        0.05,
        "Each source point is kept with this probability; 1 keeps all",
        unit="-",
        minimum=1e-5,
        maximum=1,
    )
    subsampling_mask: str = option(
        "redrawn",
        "redrawn: another mask in each run; frozen: one for all runs; frozen_in_order: one for "
        "all runs, drawn over the rows that the range filter left, so that a removed point shifts "
        "the rest",
        choices=("redrawn", "frozen", "frozen_in_order"),
    )
    initial_pose_composition: str = option(
        "right",
        "right: T_gt exp(xi) (paper, Eq. 4); left_inverse: exp(-xi) T_gt (released code)",
        choices=("right", "left_inverse"),
    )
    noise_draws: int = option(
        1,
        "Draws K of what the causes draw for all runs at once, such as sensor noise; draw k serves "
        "runs k n/K to (k+1) n/K - 1",
        unit="-",
        minimum=1,
        maximum=10_000,
    )
    common_random_numbers: bool = option(
        True, "Whether the same draws serve every setting of a pair"
    )


@dataclass(frozen=True)
class Streams:
    """The random numbers of a pair, by name; `branch` names an independent set of draws."""

    seed: int
    sequence: str
    reference: int
    source: int
    branch: str = ""

    def branched(self, branch: str) -> Streams:
        return replace(self, branch=branch)

    def generator(self, name: str) -> np.random.Generator:
        words = (crc32(self.sequence.encode()), self.reference, self.source)
        stream = crc32(f"{self.branch}{name}".encode())
        return np.random.default_rng(np.random.SeedSequence([self.seed, *words, stream]))


class Start(NamedTuple):
    """What an estimator gets of a setting: source points (m, 3) [m] and where its runs begin.

    usable (m,): the points that causes and range filter leave; rows: of each of r runs, its
    subsample of the usable ones, ascending, or of the first alone if the kind uses one subsample;
    initial_xi (r, 6), T_initial (r, 4, 4): initial poses. Settings of which only the initial poses
    differ hold the same `rows`, one after the other.

    For estimators that are told the perturbation instead of drawing it: initial_deviation (6,)
    [rad x3, m x3] of the initial poses, source_variance (m,) [m^2] of the white noise on each
    coordinate of the points.
    """

    setting: Setting
    source: np.ndarray
    usable: np.ndarray
    rows: list
    initial_xi: np.ndarray
    T_initial: np.ndarray
    initial_deviation: np.ndarray
    source_variance: np.ndarray


class Group(NamedTuple):
    """Settings that share a perturbed reference (n, 3) [m], range-filtered, in one noise draw.

    runs (r,): numbers of the runs that the draw serves; streams: of the settings' branch; starts:
    of each setting, made as they are asked for, since the rows of all may not fit into memory.
    Starts with the same source points hold the same array, one after the other.
    reference_variance (n,) [m^2]: of the white noise on each coordinate of the reference.
    """

    pair: Pair
    reference: np.ndarray
    noise_draw: int
    runs: np.ndarray
    streams: Streams
    starts: Iterator[Start]
    reference_variance: np.ndarray


def groups(
    pair: Pair,
    settings: Iterable[Setting],
    estimator: Estimator,
    deviation: np.ndarray,
    streams: Streams,
) -> Iterator[Group]:
    """The settings (plan.Setting) of a pair, as `Group`s.

    estimator: an estimators.Estimator; deviation (6,): standard deviation of xi at initial pose
    scale 1 [rad x3, m x3]; streams: `Streams` of the pair. Raises PerturbationError if a cause
    cannot be applied to the pair.
    """
    pair = pair.for_chain(estimator.perturbing.minimum_range)

    @lru_cache(maxsize=2)  # few: of each branch, they hold the subsamples
    def draws_of(branch):
        return Draws(pair, estimator, deviation, streams.branched(branch))

    for (branch, _), members in _of_one_reference(settings, estimator):
        draws = draws_of(branch)
        for noise_draw, runs in enumerate(draws.shares()):
            moved = draws.moved(members[0], "reference", noise_draw)
            seen = draws.seen_reference(members[0], moved, noise_draw)
            yield Group(
                pair,
                seen,
                noise_draw,
                runs,
                draws.streams,
                draws.starts(members, moved, noise_draw, runs),
                draws.noise_variance(members[0], "reference", seen),
            )


def number_of_groups(settings: Iterable[Setting], estimator: Estimator) -> int:
    """How many `groups` the settings of a pair are."""
    return len(_of_one_reference(settings, estimator)) * estimator.perturbing.noise_draws


def _of_one_reference(settings, estimator):
    """Settings that share their draws and the perturbed reference, by these."""
    on_reference = [cause for cause in estimator.causes.values() if cause.acts_on("reference")]
    return _grouped(settings, lambda s: (_branch(s, estimator), s.levels_of(on_reference)))


def points_of_a_run(pair: Pair, setting: Setting, estimator: Estimator, streams: Streams) -> float:
    """How many source points the causes of a setting leave a run, in the mean of its runs.

    Counted on the raw source, before anything moves its points.
    """
    draws = Draws(pair, estimator, None, streams)
    in_range = draws.in_range(pair.source)
    counts = []
    for noise_draw, runs in enumerate(draws.shares()):
        usable = draws.kept(setting, "source", noise_draw) & in_range
        counts += [len(rows) for rows in draws.subsamples(usable, setting, runs)]
    return float(np.mean(counts))


def require_points(pair: Pair, setting: Setting, estimator: Estimator, streams: Streams) -> None:
    """Raise PerturbationError if the causes of a setting leave a run fewer than FEWEST_POINTS.

    In the mean of its runs: single ones may have too few links, and are then left out.
    """
    left = points_of_a_run(pair, setting, estimator, streams)
    if left < FEWEST_POINTS:
        in_range = np.linalg.norm(pair.source, axis=1) > estimator.perturbing.minimum_range
        on = _on(estimator.causes.values(), setting)
        removing = [(cause, level) for cause, level in on if cause.hook() in ("keep", "thin")]
        raise PerturbationError(
            f"{streams.sequence}, scans {streams.reference} and {streams.source}: "
            f"{', '.join(f'{cause.name} {level:g}' for cause, level in removing)} and "
            f"subsampling_probability {estimator.perturbing.subsampling_probability:g} leave a run "
            f"{left:.4g} of {in_range.sum()} source points beyond the minimum range in the mean, "
            f"expected at least {FEWEST_POINTS}.\nHint: smaller levels of these causes, or a "
            "larger subsampling_probability."
        )


def batches(starts: Iterable[Start], runs: int, rows: int) -> Iterator[list[Start]]:
    """Consecutive starts with the same source points, at most so many runs and rows at once.

    rows: of all their subsamples; those that several runs share count once.
    """
    batch: list[Start] = []
    held: dict[int, int] = {}
    for start in starts:
        needed = held | {id(run): len(run) for run in start.rows}
        number = (len(batch) + 1) * len(start.T_initial)
        full = number > runs or sum(needed.values()) > rows
        if batch and (full or start.source is not batch[0].source):
            yield batch
            batch, needed = [], {id(run): len(run) for run in start.rows}
        batch.append(start)
        held = needed
    if batch:
        yield batch


def alike(starts: Iterable[Start], field: str = "rows") -> Iterator[list[Start]]:
    """Lists of consecutive starts with the same `rows`, or the same `usable` points.

    Those with the same rows differ in their initial poses alone.
    """
    same: list[Start] = []
    for start in starts:
        if same and getattr(start, field) is not getattr(same[0], field):
            yield same
            same = []
        same.append(start)
    if same:
        yield same


def subsample(count: int, probability: float, generator: np.random.Generator) -> np.ndarray:
    """Rows (k,) out of `count` that random subsampling keeps, in ascending order.

    Drawn as gaps between kept rows, which are geometric: the law is that of one coin per row.
    """
    if probability == 1:
        return np.arange(count)
    expected = count * probability
    size = int(expected + 6 * np.sqrt(expected) + 10)
    rows = np.cumsum(generator.geometric(probability, size)) - 1
    while rows[-1] < count:
        more = np.cumsum(generator.geometric(probability, size))
        rows = np.concatenate([rows, rows[-1] + more])
    return rows[: np.searchsorted(rows, count)]


class Draws:
    """What the causes make of a pair with the draws that the settings of one branch share."""

    def __init__(
        self, pair: Pair, estimator: Estimator, deviation: np.ndarray | None, streams: Streams
    ) -> None:
        self.pair = pair.for_chain(estimator.perturbing.minimum_range)
        self.perturbing = estimator.perturbing
        self.number = estimator.number_of_runs
        self.one_subsample = estimator.kind.one_subsample
        self.deviation = deviation
        self.streams = streams
        # Of no method of its own, which would keep all masks until the next look for garbage.
        self.subsample = cache(partial(_subsample, streams, self.perturbing))
        causes = [cause.of_pair(self.pair) for cause in estimator.causes.values()]
        self.moving, self.keeping, self.starting, self.thinning = (
            [cause for cause in causes if cause.hook() == hook] for hook in HOOKS
        )
        self.replacing = [cause for cause in causes if cause.replaces]

    @cached_property
    def initial_pose_draws(self) -> np.ndarray:
        """Standard normal (runs, 6); what run r draws does not depend on the number of runs."""
        return self.streams.generator("initial_pose").standard_normal((self.number, 6))

    def shares(self) -> list[np.ndarray]:
        """Numbers (r,) of the runs that each noise draw serves."""
        return np.split(np.arange(self.number), self.perturbing.noise_draws)

    def moved(self, setting: Setting, scan: str, noise_draw: int) -> np.ndarray:
        """The reference or the source (n, 3) [m] of a setting, as it is measured."""
        points = getattr(self.pair, scan)
        for cause, level in self._moves(setting):
            if scan in cause.scans:
                points = cause.move(points, scan, level, noise_draw, self.streams)
        return points

    def seen_reference(self, setting: Setting, moved: np.ndarray, noise_draw: int) -> np.ndarray:
        """The reference (k, 3) [m] that an estimator sees, from the measured one (n, 3)."""
        points = moved
        for cause, level in self._moves(setting):
            points = cause.move_again(points, "reference", level, noise_draw, self.streams)
        usable = self.kept(setting, "reference", noise_draw) & self.in_range(points)
        return points[usable]

    def _moves(self, setting):
        """(cause, level) of the causes that move points in a setting, in the order they act in."""
        levels = ((cause, setting.level(cause)) for cause in reversed(self.moving))
        return [(c, level) for c, level in levels if level != c.off or c.acts_when_off]

    def noise_variance(self, setting: Setting, scan: str, points: np.ndarray) -> np.ndarray:
        """Variance [m^2] (n,) of the white noise on each coordinate of perturbed points (n, 3)."""
        variance = np.zeros(len(points))
        for cause, level in self._moves(setting):
            if scan in cause.scans:
                variance += cause.noise_variance(points, scan, level)
        return variance

    def starts(
        self, settings: Iterable[Setting], reference: np.ndarray, noise_draw: int, runs: np.ndarray
    ) -> Iterator[Start]:
        """The `Start` of each setting; those with the same source points one after the other.

        reference (n, 3) [m]: as it is measured; runs (r,): their numbers.
        """
        for _, same_source in _grouped(settings, lambda s: s.levels_of(self.moving)):
            source = self.moved(same_source[0], "source", noise_draw)
            for _, same_mask in _grouped(same_source, lambda s: s.levels_of(self.keeping)):
                left, usable = self._usable(same_mask[0], reference, source, noise_draw)
                variance = self.noise_variance(same_mask[0], "source", left)
                for _, same_rows in _grouped(same_mask, lambda s: s.levels_of(self.thinning)):
                    rows = self.subsamples(usable, same_rows[0], runs)
                    for setting in same_rows:
                        xi, T_initial, deviation = self._initial(setting, runs)
                        yield Start(setting, left, usable, rows, xi, T_initial, deviation, variance)

    def _usable(self, setting, reference, source, noise_draw):
        """Source points (k, 3) of a setting, and which of them causes and range filter leave."""
        for cause in self.replacing:
            level = setting.level(cause)
            source = cause.replace(self.pair, reference, source, level, self.streams)
            self._refuse_others(cause, setting)
        if self.replacing:
            return source, self.in_range(source)
        return source, self.kept(setting, "source", noise_draw) & self.in_range(source)

    def _refuse_others(self, replacing, setting):
        others = [cause for cause, _ in _on([*self.keeping, *self.thinning], setting)]
        for cause in others:
            if cause is not replacing:
                raise PerturbationError(
                    f"{cause.name} removes rows of the raw source, which {replacing.name} has "
                    "replaced by others.\nHint: only `overlap_removal: raw` goes with it."
                )

    def kept(self, setting: Setting, scan: str, noise_draw: int) -> np.ndarray:
        """Mask of the raw rows of a scan that the voxel filter and the causes leave."""
        left, side = self.left(setting, scan, noise_draw), self.perturbing.voxel_size
        return left if side is None else left & _on_grid(self.pair, scan, side)

    def left(self, setting: Setting, scan: str, noise_draw: int) -> np.ndarray:
        """Mask of the raw rows of a scan that the causes leave, before any filter."""
        left = np.ones(len(getattr(self.pair, scan)), dtype=bool)
        for cause, level in _on(self.keeping, setting):
            if scan in cause.scans:
                left &= cause.keep(self.pair, scan, level, noise_draw, self.streams)
        return left

    def in_range(self, points: np.ndarray) -> np.ndarray:
        """Mask (n,) of the points (n, 3) [m] beyond the minimum range."""
        return np.linalg.norm(points, axis=1) > self.perturbing.minimum_range

    def _initial(self, setting, runs):
        """initial_xi (r, 6) [rad, m], T_initial (r, 4, 4) of the runs of a setting (Eq. 4).

        And the standard deviation (6,) [rad x3, m x3] of which they are drawn.
        """
        deviation = self.deviation
        for cause, level in _on(self.starting, setting):
            deviation = cause.start(deviation, level)
        xi = deviation * self.initial_pose_draws[runs]
        T_reference_source = self.pair.T_reference_source
        if self.perturbing.initial_pose_composition == "right":
            return xi, T_reference_source @ se3.exp(xi), deviation
        return xi, se3.exp(-xi) @ T_reference_source, deviation

    def subsamples(
        self, usable: np.ndarray, setting: Setting, runs: np.ndarray
    ) -> list[np.ndarray]:
        """Source rows that a setting leaves of the subsamples of runs (r,): `Start.rows`.

        usable (m,): which source points there are.
        """
        runs = runs[:1] if self.one_subsample else runs
        return self.thinned(self.rows(usable, runs), setting, runs)

    def rows(self, usable: np.ndarray, runs: np.ndarray) -> list[np.ndarray]:
        """Source rows of each run: its subsample of the usable ones (m,), ascending.

        Runs with the same subsample get the same array.
        """
        if self.perturbing.subsampling_mask == "frozen_in_order":
            usable = np.flatnonzero(usable).astype(np.int32)
            return [usable[self.subsample(len(usable), 0)]] * len(runs)
        takes_all = self.perturbing.subsampling_probability == 1
        if self.perturbing.subsampling_mask == "frozen" or takes_all:
            return [self._usable_rows(usable, 0)] * len(runs)
        return [self._usable_rows(usable, run) for run in runs]

    def thinned(
        self, rows: list[np.ndarray], setting: Setting, runs: np.ndarray
    ) -> list[np.ndarray]:
        """Of the rows (k,) of each of the runs (r,), those that the causes of a setting leave."""
        for cause, level in _on(self.thinning, setting):
            count = len(self.pair.source)
            rows = [
                cause.thin(part, run, level, count, self.streams)
                for part, run in zip(rows, runs, strict=True)
            ]
        return rows

    def _usable_rows(self, usable, mask):
        drawn = self.subsample(len(usable), mask)
        return drawn[usable[drawn]]


def _subsample(streams, perturbing, count, mask):
    generator = streams.generator(f"subsample/{mask}")
    return subsample(count, perturbing.subsampling_probability, generator).astype(np.int32)


@lru_cache(maxsize=2)
def _on_grid(pair, scan, side):
    """Mask of the raw rows of a scan that a voxel grid of that side keeps, out of those in range.

    On the clean cloud: noise moves no point into another cell, and no other takes the place of one
    that is removed, so that settings differ by their causes alone.
    """
    points = getattr(pair, scan)
    kept = np.linalg.norm(points, axis=1) > pair.minimum_range
    kept[kept] = nearest_to_cell_centres(points[kept], side)
    return kept


def _on(causes, setting):
    """(cause, level) of the causes that are on in a setting."""
    levels = ((cause, setting.level(cause)) for cause in causes)
    return [(cause, level) for cause, level in levels if level != cause.off]


def _branch(setting, estimator):
    """Name of the set of draws that a setting uses; settings with one name share every draw."""
    branch = f"replicate/{setting.replicate}/" if setting.replicate else ""
    if setting.again:
        branch += "again/"
    if not estimator.perturbing.common_random_numbers:
        on = _on(estimator.causes.values(), setting)
        branch += f"setting/{','.join(f'{cause.name}={level}' for cause, level in on)}/"
    return branch


def _grouped(items, key):
    """Items by key, keys in the order of their first item."""
    groups = defaultdict(list)
    for item in items:
        groups[key(item)].append(item)
    return groups.items()
