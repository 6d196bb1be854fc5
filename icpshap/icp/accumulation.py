"""One iteration of many runs: from poses to the Gram matrices of their kept links.

Idea: the outer loop goes over neighbourhoods of source points, the inner one over runs, so that
the part of the reference near a neighbourhood is read from memory once and then serves every run.
Its size is such that all queries of one fit into the cache; they are matched together (`matching`),
and each run adds its links to its own sums: the link lengths decide which (`trimming`), the error
metric what (`minimisers`).

Exactness: a run's sums are taken one link after the other in the spatial order of its source
points; links inside its band follow at the end. Neither depends on which runs are computed
together, or on the size of a neighbourhood.

Measured: docs/engine.md.
"""

from typing import NamedTuple

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.compiled import jit, prefetch
from icpshap.icp.matching import match, work_arrays
from icpshap.icp.minimisers import write_features
from icpshap.icp.products import FEATURES, ROW, add_products
from icpshap.icp.trimming import ROOM, SAMPLE, predicted_bands, sampled_bands, select

REPEATED_LINKS = 5_000_000  # of runs repeated together with a band that holds all their links
QUERIES = 32_768  # about that many are matched together: their arrays stay in the cache
BLOCK = 256  # source points that are matched together at least
PART = 256  # links whose features are written before their products: they stay in the cache
AHEAD = 48  # links between asking for a reference point's cache line and reading it
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
    count: np.ndarray  # (R,) int64 links in the band; more than its room: some were not stored
    # distance [m^2], found: reference point, tree order, position: source point, spatial order
    links: np.ndarray


class Sums(NamedTuple):
    """Sums over links of R runs."""

    gram: np.ndarray  # (R, FEATURES, ROW) Gram matrix of the kept links' features, and zeros
    kept: np.ndarray  # (R,) int64 links kept
    links: np.ndarray  # (R,) int64 links made


def once_each(function, arrays):
    """[function(array) for array in arrays], computed once for every distinct object among them."""
    distinct = {id(array): array for array in arrays}
    results = {key: function(array) for key, array in distinct.items()}
    return [results[id(array)] for array in arrays]


def make_batch(points, positions):
    """Batch of spatially ordered points (m, 3) and a list of R ascending int32 arrays."""
    distinct = list({id(run): run for run in positions}.values())
    first = np.cumsum([0] + [len(run) for run in distinct[:-1]])
    first = {id(run): start for run, start in zip(distinct, first, strict=True)}
    edges = np.minimum(np.arange(0, len(points) + BLOCK, BLOCK), len(points)).astype(np.int32)
    block_start = once_each(lambda run: first[id(run)] + np.searchsorted(run, edges), positions)
    return Batch(points, np.concatenate(distinct), np.array(block_start))


def band_room(links):
    """How many links a band has room for, of runs with so many links (R,)."""
    return np.where(links > 2 * SAMPLE, (links * ROOM).astype(np.int64), links)


def make_band(room):
    """A band that holds every link, with room for `room` (R,) of them."""
    start = np.concatenate([[0], np.cumsum(room)])
    return Band(
        lower=np.full(len(room), -np.inf),
        upper=np.full(len(room), np.inf),
        start=start,
        count=np.zeros(len(room), dtype=np.int64),
        links=np.empty(start[-1], dtype=BAND_LINK),
    )


@jit
def accumulate(tree, lists, surface, batch, T, active, matches, limit, metric, work, band, sums):
    """Match the active runs at poses T (R, 4, 4); sum the links below each run's band."""
    # Named once: taking an array out of a tuple, or a slice of one, costs more than a link.
    points, positions, block_start = batch.points, batch.positions, batch.block_start
    qx, qy, qz = work.x, work.y, work.z
    gram, kept, links = sums.gram, sums.kept, sums.links
    in_band, room = band.count, band.start
    band_links, band_lower, band_upper = band.links, band.lower, band.upper
    found = np.empty(qx.shape[0] * matches + AHEAD, np.int32)
    distance = np.empty(qx.shape[0] * matches)
    stack = np.empty(kdtree.STACK, np.int32)
    near = np.empty(qx.shape[0] * matches + 1, np.int32)  # links of a run in its band
    features = np.zeros((PART, ROW))
    for run in active:
        gram[run] = 0.0
        kept[run] = 0
        links[run] = 0
        in_band[run] = 0
    blocks = block_start.shape[1] - 1
    first = last = 0
    while last < blocks:
        first, expected = last, 0
        while last < blocks:
            for run in active:
                expected += block_start[run, last + 1] - block_start[run, last]
            if last > first and expected > qx.shape[0]:
                break
            last += 1
        count = 0
        for run in active:
            r00, r01, r02, tx = T[run, 0, 0], T[run, 0, 1], T[run, 0, 2], T[run, 0, 3]
            r10, r11, r12, ty = T[run, 1, 0], T[run, 1, 1], T[run, 1, 2], T[run, 1, 3]
            r20, r21, r22, tz = T[run, 2, 0], T[run, 2, 1], T[run, 2, 2], T[run, 2, 3]
            for k in range(block_start[run, first], block_start[run, last]):
                p = positions[k]
                x, y, z = points[p, 0], points[p, 1], points[p, 2]
                qx[count] = r00 * x + r01 * y + r02 * z + tx
                qy[count] = r10 * x + r11 * y + r12 * z + ty
                qz[count] = r20 * x + r21 * y + r22 * z + tz
                count += 1
        match(tree, lists, matches, limit, count, work, found, distance, stack)
        query = 0
        for run in active:
            lower, upper = band_lower[run], band_upper[run]
            row = made = inside = 0
            position = block_start[run, first] - query  # where the position of query 0 would be
            for _ in range(block_start[run, first], block_start[run, last]):
                x, y, z = qx[query], qy[query], qz[query]
                if row > PART - matches:
                    add_products(features, row, gram, run)
                    kept[run] += row
                    row = 0
                for link in range(query * matches, (query + 1) * matches):
                    prefetch(surface, np.int64(found[link + AHEAD]) * surface.shape[1])
                    d2 = distance[link]
                    # Written for every link, as a branch costs more; the next one overwrites it.
                    write_features(metric, x, y, z, surface, found[link], features, row)
                    row += d2 < lower
                    near[inside] = link
                    inside += (d2 >= lower) & (d2 < upper)
                    made += d2 < np.inf
                query += 1
            entry = room[run] + in_band[run]
            for k in range(min(inside, room[run + 1] - entry)):
                link = near[k]
                band_links[entry + k].distance = distance[link]
                band_links[entry + k].found = found[link]
                band_links[entry + k].position = positions[position + link // matches]
            in_band[run] += inside
            add_products(features, row, gram, run)
            kept[run] += row
            links[run] += made


@jit
def settle(surface, batch, T, active, metric, rank, band, sums, threshold):
    """Find each active run's threshold in its band and add the links in the band up to it.

    rank: (R,) position of the threshold among a run's links; as many as its links: keep all.
    threshold: (R,) [m^2], set; NaN where the band does not contain it.
    """
    features = np.zeros((PART, ROW))
    gram, kept, links = sums.gram, sums.kept, sums.links
    points, band_links = batch.points, band.links
    room = 0
    for run in active:
        room = max(room, band.start[run + 1] - band.start[run])
    values = np.empty(room)
    for run in active:
        first, count = band.start[run], band.count[run]
        wanted = rank[run] - kept[run]
        if count > band.start[run + 1] - first:
            threshold[run] = np.nan
            continue
        if rank[run] >= links[run]:
            threshold[run] = np.inf
        elif 0 <= wanted < count:
            for k in range(count):
                values[k] = band_links[first + k].distance
            threshold[run] = select(values, count, wanted)
        else:
            threshold[run] = np.nan
            continue
        row = 0
        for entry in range(first, first + count):
            if band_links[entry].distance <= threshold[run]:
                p = band_links[entry].position
                px, py, pz = points[p, 0], points[p, 1], points[p, 2]
                x = T[run, 0, 0] * px + T[run, 0, 1] * py + T[run, 0, 2] * pz + T[run, 0, 3]
                y = T[run, 1, 0] * px + T[run, 1, 1] * py + T[run, 1, 2] * pz + T[run, 1, 3]
                z = T[run, 2, 0] * px + T[run, 2, 1] * py + T[run, 2, 2] * pz + T[run, 2, 3]
                write_features(metric, x, y, z, surface, band_links[entry].found, features, row)
                row += 1
                kept[run] += 1
                if row == PART:
                    add_products(features, row, gram, run)
                    row = 0
        add_products(features, row, gram, run)


class KeptLinks:
    """The kept links of a batch of runs, iteration by iteration, as sums of their features.

    points: (m, 3) source points in spatial order [m]; positions: those of each run, ascending.
    """

    def __init__(self, reference, points, positions, chain):
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
            np.zeros((runs, FEATURES, ROW)),
            np.zeros(runs, dtype=np.int64),
            np.zeros(runs, dtype=np.int64),
        )
        self.sampled = self.possible >= 2 * SAMPLE
        self.sample = make_batch(
            points,
            once_each(lambda run: run[:: max(chain.matches * len(run) // SAMPLE, 1)], positions),
        )
        largest_block = np.diff(self.batch.block_start, axis=1).sum(axis=0).max()
        self.work = work_arrays(max(QUERIES, largest_block))

    def __call__(self, active, T):
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
        sampled_bands(distance, sample.start, sample.count, unknown, ratio, band.lower, band.upper)

    def _sum(self, active, T, batch, band):
        limit = self.chain.maximum_distance
        accumulate(
            self.tree,
            self.lists,
            self.surface,
            batch,
            T,
            active,
            self.chain.matches,
            np.inf if limit is None else limit * limit,
            self.chain.error_minimiser.metric,
            self.work,
            band,
            self.sums,
        )

    def _settle(self, active, T, batch, band):
        rank = self.chain.outlier_filter.rank(self.sums.links)
        metric = self.chain.error_minimiser.metric
        settle(self.surface, batch, T, active, metric, rank, band, self.sums, self.threshold)
