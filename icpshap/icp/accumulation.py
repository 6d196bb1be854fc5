"""One iteration of many runs: from poses to the Gram matrices of their kept links.

Idea: the outer loop goes over neighbourhoods of source points, the inner one over runs, so that
the part of the reference near a neighbourhood is read from memory once and then serves every run.
Its size is such that all queries of one fit into the cache. They are matched together (`matching`),
those of runs near one another by what one of these has found (`packets`); the link lengths decide
which links are kept (`trimming`), and the runs, several at a time, add these to their sums
(`lanes`), of what the error metric says (`minimisers`).

Whether a link is kept is read off its key, and its length is computed only where the key leaves
that open, or where the link is in the band.

Exactness: a run's sums are taken one link after the other in the spatial order of its source
points; links inside its band follow at the end. Neither depends on which runs are computed
together, or on the size of a neighbourhood.

Measured: docs/engine.md.
"""

from typing import NamedTuple

import numpy as np

from icpshap.icp.batches import Batch, make_batch, once_each, padded
from icpshap.icp.candidates import Lists
from icpshap.icp.chain import Chain
from icpshap.icp.compiled import Array, jit, jit_borrowing
from icpshap.icp.keys import TOGETHER, decide, known, lowest
from icpshap.icp.lanes import LANES, PRODUCTS, add_links
from icpshap.icp.matching import Work, match, move, squared_distance, work_arrays
from icpshap.icp.packets import MATCHES, NEAR, Together, clusters, match_clusters, together
from icpshap.icp.reference import Reference
from icpshap.icp.selection import select
from icpshap.icp.trimming import ROOM, SAMPLE, predicted_bands, sampled_bands

REPEATED_LINKS = 5_000_000  # of runs repeated together with a band that holds all their links
QUERIES = 49_152  # about that many are matched together: their arrays stay in the cache
PART = 256  # links of a run's band that are added together
BAND_LINK = np.dtype([("distance", "f8"), ("found", "i4"), ("position", "i4")])


class Band(NamedTuple):
    """The links of R runs whose length is near the trimming threshold."""

    lower: Array  # (R,) [m^2] links shorter than this are summed at once
    upper: Array  # (R,) [m^2] links at least this long are dropped
    start: Array  # (R + 1,) int64 each run's room in `links`
    number: Array  # (R,) int64 links in the band; more than its room: some were not stored
    # distance [m^2], found: reference point, tree order, position: source point, spatial order
    links: Array


class Queries(NamedTuple):
    """Where the queries of R runs are; and of none, a spare one, which has no queries."""

    begin: Array  # (R + 1,) int64 place of the first in `matching.Work`
    start: Array  # (R,) int64 place of its position in `Batch.positions`
    number: Array  # (R + 1,) int64


class Sums(NamedTuple):
    """Sums over links of R runs."""

    # (R + 1, PRODUCTS) upper triangle of the Gram matrix of the kept links' features; a spare one
    products: Array
    kept: Array  # (R,) int64 links kept
    links: Array  # (R,) int64 links made


def band_room(links: Array) -> Array:
    """How many links a band has room for, of runs with so many links (R,)."""
    return np.where(links > 2 * SAMPLE, (links * ROOM).astype(np.int64), links)


def make_band(room: Array) -> Band:
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
def _decide(lists, limit, positions, work, active, queries, band, sums, rows):
    """Which links of the active runs are kept: those get their reference points as `rows`."""
    # Named once: taking an array out of a tuple costs more than deciding about a link.
    points, matches, largest = lists.tree.points, lists.matches, lists.largest
    links, band_links, x, y, z = work.links, band.links, work.x, work.y, work.z
    start, begin, number = queries.start, queries.begin, queries.number
    room, in_band, none = band.start, band.number, np.int32(points.shape[0])
    made_key, unmade_key = known(limit, largest)
    for run in active:
        lower, upper = band.lower[run], band.upper[run]
        kept_key, _ = known(lower, largest)
        _, dropped_key = known(upper, largest)
        kept_key, dropped_key = min(kept_key, made_key), min(dropped_key, unmade_key)
        entry = room[run] + in_band[run]
        position = start[run] - begin[run]
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
                d2 = squared_distance(points, np.uint64(found), x[query], y[query], z[query])
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
def _place(batch, order, alone, first, last, queries):
    """Where the queries of the runs in order are, at some blocks; returns how many there are.

    Those of the first `alone` runs follow one another; the others' have room for whole vectors.
    """
    count = 0
    for k in range(len(order)):
        run = order[k]
        block_start = batch.block_start if k < alone else batch.packets.block_start
        queries.begin[run], queries.start[run] = count, block_start[first, run]
        queries.number[run] = block_start[last, run] - block_start[first, run]
        count += queries.number[run] if k < alone else padded(queries.number[run])
    return count


@jit_borrowing
def _move(batch, T, runs, queries, work):
    """The queries of the runs; returns how many there are."""
    count = 0
    for run in runs:
        start = queries.start[run]
        own = batch.positions[start : start + queries.number[run]]
        count += move(batch.points, own, T, run, work.x, work.y, work.z, queries.begin[run])
    return count


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
    lists: Lists,
    limit: float,
    surface: Array,
    metric: int,
    batch: Batch,
    T: Array,
    order: Array,
    ends: Array,
    work: Work,
    together: Together,
    band: Band,
    sums: Sums,
) -> None:
    """Match the active runs at poses T (R, 4, 4); sum the links below each run's band.

    order, ends: the active runs, see `packets.clusters`.
    """
    x, y, z, matches = work.x, work.y, work.z, lists.matches
    runs, spare, alone = T.shape[0], x.shape[0] - 1, order[: ends[0]]
    rows = np.empty((spare + 1) * matches, np.int32)
    rows[spare * matches :] = lists.tree.points.shape[0]
    queries = Queries(
        np.zeros(runs + 1, np.int64), np.zeros(runs, np.int64), np.zeros(runs + 1, np.int64)
    )
    lane_run, lane_begin, lane_number = np.zeros((3, LANES), np.int64)
    for run in order:
        sums.products[run] = 0.0
        sums.kept[run] = 0
        sums.links[run] = 0
        band.number[run] = 0
    blocks = batch.block_start.shape[0] - 1
    first = last = np.int64(0)  # of a literal, numba compiles what it is given to twice
    while last < blocks:
        first, count = last, 0
        while last < blocks and count <= work.where.shape[0]:
            last += 1
            count = _place(batch, order, len(alone), first, last, queries)
        if count > work.where.shape[0]:
            last -= 1
            _place(batch, order, len(alone), first, last, queries)
        match(lists, limit, _move(batch, T, alone, queries, work), work)
        if len(ends) > 1:
            match_clusters(
                lists, limit, batch, T, order, ends, first, last, queries.begin, work, together
            )
        _decide(lists, limit, batch.positions, work, order, queries, band, sums, rows)
        # Lanes end together if their runs have equally many queries.
        ordered = _by_number(order, queries.number)
        for group in range(0, len(ordered), LANES):
            for lane in range(LANES):
                run = ordered[group + lane] if group + lane < len(ordered) else runs
                lane_run[lane], lane_begin[lane] = run, queries.begin[run]
                lane_number[lane] = queries.number[run]
            add_links(
                *(metric, x, y, z, rows, matches, surface),
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
def _take(batch, T, run, band, entry, threshold, work, positions, rows, begin):
    """Queries and reference points of up to PART links of a band not longer than a threshold [m^2].

    entry: the first of the links; begin: place of the queries. Returns the entry after them, and
    how many were taken.
    """
    links, end, taken = band.links, band.start[run] + band.number[run], 0
    while entry < end and taken < PART:
        link = links[np.uint64(entry)]
        entry += 1
        if link.distance <= threshold:
            positions[np.uint64(taken)] = link.position
            rows[np.uint64(begin + taken)] = link.found
            taken += 1
    move(batch.points, positions[:taken], T, run, work[0], work[1], work[2], begin)
    return entry, taken


@jit
def settle(
    surface: Array,
    metric: int,
    batch: Batch,
    T: Array,
    active: Array,
    rank: Array,
    band: Band,
    sums: Sums,
    threshold: Array,
) -> None:
    """Find each active run's threshold in its band and add the links in the band up to it.

    rank: (R,) position of the threshold among a run's links; as many as its links: keep all.
    threshold: (R,) [m^2], set; NaN where the band does not contain it.
    """
    _find_thresholds(active, rank, band, sums, threshold)
    runs, spare = T.shape[0], LANES * PART
    x, y, z = np.zeros(spare + 1), np.zeros(spare + 1), np.zeros(spare + 1)
    rows = np.full(spare + 1, surface.shape[0] - 1, np.int32)
    positions = np.empty(PART, np.int32)
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
                run = lane_run[lane]
                number[lane] = 0
                if entry[lane] < end[lane]:
                    entry[lane], number[lane] = _take(
                        *(batch, T, run, band, entry[lane], threshold[run]),
                        *((x, y, z), positions, rows, lane_begin[lane]),
                    )
                    sums.kept[run] += number[lane]
            add_links(
                *(metric, x, y, z, rows, 1, surface),
                *(lane_begin, number, spare, sums.products, lane_run),
            )


class KeptLinks:
    """The kept links of a batch of runs, iteration by iteration, as sums of their features.

    points: (m, 3) source points in spatial order [m]; positions: those of each run, ascending;
    packets: (R,) number of each run's packet, ascending.
    """

    def __init__(
        self,
        reference: Reference,
        points: Array,
        positions: list[Array],
        packets: Array,
        chain: Chain,
    ) -> None:
        runs, matches = len(positions), chain.matches
        alone = np.arange(runs)
        self.lists = reference.lists(matches)
        self.surface = reference.surface(chain.error_minimiser.needs_normals)
        self.chain = chain
        self.batch = make_batch(points, positions, packets if matches in MATCHES else alone)
        self.possible = matches * np.array([len(run) for run in positions])
        self.band = make_band(band_room(self.possible))
        self.threshold = np.full(runs, np.nan)
        self.previous = np.full(runs, np.nan)
        kept, links = np.zeros((2, runs), dtype=np.int64)
        self.sums = Sums(np.zeros((runs + 1, PRODUCTS)), kept, links)
        self.sampled = self.possible >= 2 * SAMPLE
        sampled = once_each(lambda run: run[:: max(matches * len(run) // SAMPLE, 1)], positions)
        self.sample = make_batch(points, sampled, alone)
        room = max(QUERIES, self.batch.largest_block())
        self.work = work_arrays(room, matches)
        self.together = together(room, runs, matches)

    def __call__(self, active: Array, T: Array) -> Sums:
        """Sums of the active runs' kept links at T (R, 4, 4), source to centred reference."""
        self._choose_bands(active, T)
        self.previous[active] = self.threshold[active]
        self._sum(active, T, self.batch, self.band)
        failed = active[np.isnan(self.threshold[active])]
        part = np.cumsum(self.possible[failed]) // REPEATED_LINKS
        for number in np.unique(part):
            repeated = failed[part == number]
            self._sum(repeated, T, self.batch, self._band_of(repeated))
        return self.sums

    def _band_of(self, active, room=None):
        """A band that holds every link of some runs, or has that much room for each."""
        rooms = np.zeros_like(self.possible)
        rooms[active] = self.possible[active] if room is None else room
        return make_band(rooms)

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
        sample = self._band_of(unknown, 2 * SAMPLE)
        self._accumulate(unknown, T, self.sample, sample)
        distance = sample.links["distance"].copy()
        sampled_bands(distance, sample.start, sample.number, unknown, ratio, band.lower, band.upper)

    def _accumulate(self, active, T, batch, band):
        longest, metric = self.chain.maximum_distance, self.chain.error_minimiser.metric
        limit = np.inf if longest is None else longest * longest
        order, ends = clusters(active, batch.packets, T, NEAR * self.lists.side[0])
        accumulate(
            *(self.lists, limit, self.surface, metric, batch, T, order, ends),
            *(self.work, self.together, band, self.sums),
        )

    def _sum(self, active, T, batch, band):
        self._accumulate(active, T, batch, band)
        metric, rank = self.chain.error_minimiser.metric, self.chain.outlier_filter.rank
        ranks = rank(self.sums.links)
        settle(self.surface, metric, batch, T, active, ranks, band, self.sums, self.threshold)
