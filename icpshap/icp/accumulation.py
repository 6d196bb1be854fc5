"""One iteration of many runs: from poses to the Gram matrices of their kept links.

Idea: the outer loop goes over neighbourhoods of source points, the inner one over runs, so that
the part of the reference near a neighbourhood is read from memory once and then serves every run.
Its size is such that all queries of one fit into the cache; they are matched together (`matching`),
the link lengths decide which links are kept (`trimming`), and the runs, several at a time, add
these to their sums (`lanes`), of what the error metric says (`minimisers`).

Whether a link is kept is read off its key, and its length is computed only where the key leaves
that open, or where the link is in the band.

Exactness: a run's sums are taken one link after the other in the spatial order of its source
points; links inside its band follow at the end. Neither depends on which runs are computed
together, or on the size of a neighbourhood.

Measured: docs/engine.md.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from icpshap.icp.compiled import jit, jit_borrowing
from icpshap.icp.keys import TOGETHER, decide, known, lowest
from icpshap.icp.lanes import LANES, PRODUCTS, add_links
from icpshap.icp.matching import match, squared_distance, work_arrays
from icpshap.icp.selection import select
from icpshap.icp.trimming import ROOM, SAMPLE, predicted_bands, sampled_bands

if TYPE_CHECKING:
    from icpshap.icp import kdtree
    from icpshap.icp.candidates import Lists
    from icpshap.icp.chain import Chain
    from icpshap.icp.matching import Work
    from icpshap.icp.reference import Reference


REPEATED_LINKS = 5_000_000  # of runs repeated together with a band that holds all their links
QUERIES = 49_152  # about that many are matched together: their arrays stay in the cache
BLOCK = 256  # source points that are matched together at least
PART = 256  # links of a run's band that are added together
BAND_LINK = np.dtype([("distance", "f8"), ("found", "i4"), ("position", "i4")])


class Batch(NamedTuple):
    """The source points of R runs, and where those of each block are."""

    points: np.ndarray  # (m, 3) source points in spatial order [m]
    positions: np.ndarray  # int32: the points a run uses, ascending, one distinct set after another
    block_start: np.ndarray  # (R, blocks + 1) int64 into positions


class Band(NamedTuple):
    """The links of R runs whose length is near the trimming threshold."""

    lower: np.ndarray  # (R,) [m^2] links shorter than this are summed at once
    upper: np.ndarray  # (R,) [m^2] links at least this long are dropped
    start: np.ndarray  # (R + 1,) int64 each run's room in `links`
    number: np.ndarray  # (R,) int64 links in the band; more than its room: some were not stored
    # distance [m^2], found: reference point, tree order, position: source point, spatial order
    links: np.ndarray


class Sums(NamedTuple):
    """Sums over links of R runs."""

    # (R + 1, PRODUCTS) upper triangle of the Gram matrix of the kept links' features; a spare one
    products: np.ndarray
    kept: np.ndarray  # (R,) int64 links kept
    links: np.ndarray  # (R,) int64 links made


Made = TypeVar("Made")


def once_each(function: Callable[[np.ndarray], Made], arrays: Sequence[np.ndarray]) -> list[Made]:
    """[function(array) for array in arrays], computed once for every distinct object among them."""
    distinct = {id(array): array for array in arrays}
    results = {key: function(array) for key, array in distinct.items()}
    return [results[id(array)] for array in arrays]


def make_batch(points: np.ndarray, positions: list[np.ndarray]) -> Batch:
    """Batch of spatially ordered points (m, 3) and a list of R ascending int32 arrays."""
    distinct = list({id(run): run for run in positions}.values())
    starts = np.cumsum([0] + [len(run) for run in distinct[:-1]])
    first = {id(run): start for run, start in zip(distinct, starts, strict=True)}
    edges = np.minimum(np.arange(0, len(points) + BLOCK, BLOCK), len(points)).astype(np.int32)
    block_start = once_each(lambda run: first[id(run)] + np.searchsorted(run, edges), positions)
    return Batch(points, np.concatenate(distinct), np.array(block_start))


def band_room(links: np.ndarray) -> np.ndarray:
    """How many links a band has room for, of runs with so many links (R,)."""
    return np.where(links > 2 * SAMPLE, (links * ROOM).astype(np.int64), links)


def make_band(room: np.ndarray) -> Band:
    """A band that holds every link, with room for `room` (R,) of them."""
    start = np.concatenate([[0], np.cumsum(room)])
    return Band(
        lower=np.full(len(room), -np.inf),
        upper=np.full(len(room), np.inf),
        start=start,
        number=np.zeros(len(room), dtype=np.int64),
        links=np.empty(start[-1], dtype=BAND_LINK),
    )


@jit_borrowing
def _decide(
    points, batch, work, active, begin, number, first, matches, limit, largest, band, sums, rows
):
    """Which links of the active runs are kept: those get their reference points as `rows`.

    begin, number: (R,) of each run's queries in `work`; first: block of the first of them; largest:
    `candidates.Lists.largest`.
    """
    # Named once: taking an array out of a tuple costs more than deciding about a link.
    links, positions, band_links = work.links, batch.positions, band.links
    x, y, z = work.x, work.y, work.z
    block_start, room, in_band = batch.block_start, band.start, band.number
    none = np.int32(points.shape[0])
    made_key, unmade_key = known(limit, largest)
    for run in active:
        lower, upper = band.lower[run], band.upper[run]
        kept_key, _ = known(lower, largest)
        _, dropped_key = known(upper, largest)
        kept_key, dropped_key = min(kept_key, made_key), min(dropped_key, unmade_key)
        entry = room[run] + in_band[run]
        position = block_start[run, first] - begin[run]
        kept = made = 0
        end = (begin[run] + number[run]) * matches
        for part in range(begin[run] * matches, end, TOGETHER):
            sure, within, unsure = decide(
                links, part, end, kept_key, dropped_key, made_key, unmade_key, none, rows
            )
            kept += sure
            made += within
            while unsure:
                link = part + lowest(unsure)
                unsure &= unsure - 1
                key, found = np.int32(links[link] >> 32), np.int32(links[link])
                if found < 0:
                    continue
                query = link // matches
                d2 = squared_distance(points, np.int64(found), x[query], y[query], z[query])
                if d2 > limit:
                    continue
                made += key >= made_key
                if d2 < lower:
                    kept += key >= kept_key
                    rows[link] = found
                elif d2 < upper:
                    if entry < room[run + 1]:
                        band_links[entry].distance = d2
                        band_links[entry].found = found
                        band_links[entry].position = positions[position + query]
                    entry += 1
        in_band[run] = entry - room[run]
        sums.kept[run] += kept
        sums.links[run] += made


@jit_borrowing
def _move(points, positions, first, last, T, run, x, y, z, begin):
    """Queries of a run, from place `begin` on: the points of its positions; returns how many."""
    r00, r01, r02, tx = T[run, 0, 0], T[run, 0, 1], T[run, 0, 2], T[run, 0, 3]
    r10, r11, r12, ty = T[run, 1, 0], T[run, 1, 1], T[run, 1, 2], T[run, 1, 3]
    r20, r21, r22, tz = T[run, 2, 0], T[run, 2, 1], T[run, 2, 2], T[run, 2, 3]
    for k in range(last - first):
        # Unsigned, or numba would ask of each index whether it counts from the end.
        p, i = np.uint64(positions[np.uint64(first + k)]), np.uint64(begin + k)
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        x[i] = r00 * px + r01 * py + r02 * pz + tx
        y[i] = r10 * px + r11 * py + r12 * pz + ty
        z[i] = r20 * px + r21 * py + r22 * pz + tz
    return last - first


@jit
def _by_number(active, number):
    """The active runs in the order of their number of queries (R,)."""
    most = 0
    for run in active:
        most = max(most, number[run])
    place = np.zeros(most + 2, np.int64)
    for run in active:
        place[number[run] + 1] += 1
    for value in range(most + 1):
        place[value + 1] += place[value]
    ordered = np.empty(len(active), np.int64)
    for run in active:
        ordered[place[number[run]]] = run
        place[number[run]] += 1
    return ordered


@jit
def accumulate(
    tree: kdtree.Tree,
    lists: Lists,
    surface: np.ndarray,
    batch: Batch,
    T: np.ndarray,
    active: np.ndarray,
    matches: int,
    limit: float,
    metric: int,
    work: Work,
    band: Band,
    sums: Sums,
) -> None:
    """Match the active runs at poses T (R, 4, 4); sum the links below each run's band."""
    # Named once: taking an array out of a tuple, or a slice of one, costs more than a link.
    points, positions, block_start = batch.points, batch.positions, batch.block_start
    qx, qy, qz = work.x, work.y, work.z
    runs, spare = T.shape[0], qx.shape[0] - 1
    rows = np.empty((spare + 1) * matches, np.int32)
    rows[spare * matches :] = tree.points.shape[0]
    begin, number = np.zeros(runs + 1, np.int64), np.zeros(runs + 1, np.int64)
    lane_run, lane_begin, lane_number = np.zeros((3, LANES), np.int64)
    for run in active:
        sums.products[run] = 0.0
        sums.kept[run] = 0
        sums.links[run] = 0
        band.number[run] = 0
    blocks = block_start.shape[1] - 1
    first = last = 0
    while last < blocks:
        first, expected = last, 0
        while last < blocks:
            for run in active:
                expected += block_start[run, last + 1] - block_start[run, last]
            if last > first and expected > work.where.shape[0]:
                break
            last += 1
        count = np.int64(0)  # no literal, for which numba would compile `match` once more
        for run in active:
            begin[run] = count
            count += _move(
                *(points, positions, block_start[run, first], block_start[run, last]),
                *(T, run, qx, qy, qz, count),
            )
            number[run] = count - begin[run]
        match(tree, lists, matches, limit, count, work)
        _decide(
            *(tree.points, batch, work, active, begin, number, first),
            *(matches, limit, lists.largest, band, sums, rows),
        )
        # Lanes end together if their runs have equally many queries.
        ordered = _by_number(active, number)
        for group in range(0, len(ordered), LANES):
            for lane in range(LANES):
                run = ordered[group + lane] if group + lane < len(ordered) else runs
                lane_run[lane], lane_begin[lane], lane_number[lane] = run, begin[run], number[run]
            add_links(
                *(metric, qx, qy, qz, rows, matches, surface),
                *(lane_begin, lane_number, spare, sums.products, lane_run),
            )


@jit
def _find_thresholds(active, rank, band, sums, threshold):
    """Set each active run's threshold; NaN where its band does not contain it."""
    room = 0
    for run in active:
        room = max(room, band.start[run + 1] - band.start[run])
    values = np.empty(room)
    for run in active:
        first, count = band.start[run], band.number[run]
        wanted = rank[run] - sums.kept[run]
        threshold[run] = np.nan
        if count > band.start[run + 1] - first:
            continue
        if rank[run] >= sums.links[run]:
            threshold[run] = np.inf
        elif 0 <= wanted < count:
            for k in range(count):
                values[k] = band.links[first + k].distance
            threshold[run] = select(values, count, wanted)


@jit_borrowing
def _take(links, entry, end, threshold, positions, rows, begin):
    """Source and reference points of up to PART links of a band not longer than a threshold [m^2].

    entry, end: where the links are; begin: place of the first in `positions` and `rows`. Returns
    where the next links are, and how many were taken.
    """
    taken = 0
    while entry < end and taken < PART:
        link = links[np.uint64(entry)]
        entry += 1
        if link.distance <= threshold:
            positions[np.uint64(begin + taken)] = link.position
            rows[np.uint64(begin + taken)] = link.found
            taken += 1
    return entry, taken


@jit
def settle(
    surface: np.ndarray,
    batch: Batch,
    T: np.ndarray,
    active: np.ndarray,
    metric: int,
    rank: np.ndarray,
    band: Band,
    sums: Sums,
    threshold: np.ndarray,
) -> None:
    """Find each active run's threshold in its band and add the links in the band up to it.

    rank: (R,) position of the threshold among a run's links; as many as its links: keep all.
    threshold: (R,) [m^2], set; NaN where the band does not contain it.
    """
    _find_thresholds(active, rank, band, sums, threshold)
    points, band_links = batch.points, band.links
    runs, spare = T.shape[0], LANES * PART
    qx, qy, qz = np.zeros((3, spare + 1))
    rows = np.full(spare + 1, surface.shape[0] - 1, np.int32)
    positions = np.empty(spare, np.int32)
    lane_run, entry, end, number = np.zeros((4, LANES), np.int64)
    lane_begin = np.arange(LANES) * PART
    for group in range(0, len(active), LANES):
        for lane in range(LANES):
            run = active[group + lane] if group + lane < len(active) else runs
            lane_run[lane], entry[lane], end[lane] = run, 0, 0
            if run < runs and not np.isnan(threshold[run]):
                entry[lane] = band.start[run]
                end[lane] = band.start[run] + band.number[run]
        while (entry < end).any():
            for lane in range(LANES):
                run, begin = lane_run[lane], lane_begin[lane]
                number[lane] = 0
                if entry[lane] < end[lane]:
                    entry[lane], number[lane] = _take(
                        *(band_links, entry[lane], end[lane], threshold[run]),
                        *(positions, rows, begin),
                    )
                    last = begin + number[lane]
                    _move(points, positions, begin, last, T, run, qx, qy, qz, begin)
                    sums.kept[run] += number[lane]
            add_links(
                *(metric, qx, qy, qz, rows, 1, surface),
                *(lane_begin, number, spare, sums.products, lane_run),
            )


class KeptLinks:
    """The kept links of a batch of runs, iteration by iteration, as sums of their features.

    points: (m, 3) source points in spatial order [m]; positions: those of each run, ascending.
    """

    def __init__(
        self, reference: Reference, points: np.ndarray, positions: list[np.ndarray], chain: Chain
    ) -> None:
        self.tree = reference.tree
        self.lists = reference.lists(chain.matches)
        self.surface = reference.surface(chain.error_minimiser.needs_normals)
        self.chain = chain
        self.batch = make_batch(points, positions)
        self.possible = chain.matches * np.array([len(run) for run in positions])
        runs = len(positions)
        self.band = make_band(band_room(self.possible))
        self.threshold = np.full(runs, np.nan)
        self.previous = np.full(runs, np.nan)
        self.sums = Sums(
            np.zeros((runs + 1, PRODUCTS)),
            np.zeros(runs, dtype=np.int64),
            np.zeros(runs, dtype=np.int64),
        )
        self.sampled = self.possible >= 2 * SAMPLE
        self.sample = make_batch(
            points,
            once_each(lambda run: run[:: max(chain.matches * len(run) // SAMPLE, 1)], positions),
        )
        largest_block = np.diff(self.batch.block_start, axis=1).sum(axis=0).max()
        self.work = work_arrays(max(QUERIES, largest_block), chain.matches)

    def __call__(self, active: np.ndarray, T: np.ndarray) -> Sums:
        """Sums of the active runs' kept links at T (R, 4, 4), source to centred reference."""
        self._choose_bands(active, T)
        self.previous[active] = self.threshold[active]
        self._sum(active, T, self.batch, self.band)
        self._settle(active, T, self.batch, self.band)
        failed = active[np.isnan(self.threshold[active])]
        part = np.cumsum(self.possible[failed]) // REPEATED_LINKS
        for number in np.unique(part):
            repeated = failed[part == number]
            room = np.zeros_like(self.possible)
            room[repeated] = self.possible[repeated]
            band = make_band(room)
            self._sum(repeated, T, self.batch, band)
            self._settle(repeated, T, self.batch, band)
        return self.sums

    def _choose_bands(self, active, T):
        band, ratio = self.band, self.chain.outlier_filter.ratio
        if ratio == 1.0:
            band.lower[:] = np.inf
            return
        band.lower[:], band.upper[:], steady = predicted_bands(self.threshold, self.previous)
        unknown = active[~steady[active]]
        band.lower[unknown], band.upper[unknown] = -np.inf, np.inf
        unknown = unknown[self.sampled[unknown]]
        if len(unknown) == 0:
            return
        room = np.zeros_like(self.possible)
        room[unknown] = SAMPLE * 2
        sample = make_band(room)
        self._sum(unknown, T, self.sample, sample)
        distance = sample.links["distance"].copy()
        sampled_bands(distance, sample.start, sample.number, unknown, ratio, band.lower, band.upper)

    def _sum(self, active, T, batch, band):
        limit = self.chain.maximum_distance
        limit = np.inf if limit is None else limit * limit
        accumulate(
            self.tree,
            self.lists,
            self.surface,
            batch,
            T,
            active,
            self.chain.matches,
            limit,
            self.chain.error_minimiser.metric,
            self.work,
            band,
            self.sums,
        )

    def _settle(self, active, T, batch, band):
        rank = self.chain.outlier_filter.rank(self.sums.links)
        metric = self.chain.error_minimiser.metric
        settle(self.surface, batch, T, active, metric, rank, band, self.sums, self.threshold)
