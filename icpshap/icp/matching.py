"""Matching: the k nearest reference points of a block of queries.

Idea: the queries of a block, all runs together, are sorted by candidate list. Each list is then
read once for all the queries in its cube, and the loop over those queries is a vector loop: per
candidate a squared distance and a network of integer minima and maxima that keeps the smallest
few. A squared distance is compared as an integer with the candidate's place in the list in its
lowest 8 bits, so distance and place move together.

Exactness: two squared distances that agree in all but those 8 bits would be ordered by place, so
the network keeps one more than k; whenever two neighbours in that order agree above the 8 bits,
the query is repeated with full distances, equal ones by lowest index. Distances are computed by
the same operations as in the k-d tree, which answers the queries outside the lists: which way a
query is answered cannot be seen in the result.

Measured: docs/engine.md.
"""

from typing import NamedTuple

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.candidates import HEADER, PACKED, locate
from icpshap.icp.compiled import bits, jit

LANES = 64
LARGEST = np.int64(0x7FFFFFFFFFFFFFFF)
PLACE = np.int64(PACKED)


class Work(NamedTuple):
    """Arrays for the queries of one block."""

    x: np.ndarray  # (n,) queries [m]
    y: np.ndarray
    z: np.ndarray
    where: np.ndarray  # (n,) int32 record of each query's list; later its group
    order: np.ndarray  # (n,) int32 queries sorted by group
    group_list: np.ndarray  # (n,) int32 record of each group
    group_end: np.ndarray  # (n,) int32 end of each group in `order`
    lane: np.ndarray  # (3 LANES,) coordinates of the queries that share a list
    key: np.ndarray  # (6 LANES,) int64 smallest keys, one row of LANES for each rank


def work_arrays(queries):
    """Work for blocks of up to that many queries."""
    coordinates = [np.empty(queries) for _ in range(3)]
    integers = [np.empty(queries, dtype=np.int32) for _ in range(4)]
    return Work(*coordinates, *integers, np.zeros(3 * LANES), np.zeros(6 * LANES, dtype=np.int64))


@jit
def _smallest_keys(points, candidates, lane, key, lanes, matches):
    """The smallest keys of every lane, ascending: at least matches + 1 rows of `key`."""
    for j in range((2 if matches == 1 else 4 if matches <= 3 else 6) * LANES):
        key[j] = LARGEST
    for k in range(candidates.shape[0]):
        q = candidates[k]
        qx, qy, qz = points[q, 0], points[q, 1], points[q, 2]
        if matches == 1:
            for j in range(lanes):
                dx, dy, dz = qx - lane[j], qy - lane[LANES + j], qz - lane[2 * LANES + j]
                a = (bits(dx * dx + dy * dy + dz * dz) & ~PLACE) | k
                b = max(a, key[j])
                key[j] = min(a, key[j])
                key[LANES + j] = min(b, key[LANES + j])
        elif matches <= 3:
            for j in range(lanes):
                dx, dy, dz = qx - lane[j], qy - lane[LANES + j], qz - lane[2 * LANES + j]
                a = (bits(dx * dx + dy * dy + dz * dz) & ~PLACE) | k
                b = max(a, key[j])
                key[j] = min(a, key[j])
                c = max(b, key[LANES + j])
                key[LANES + j] = min(b, key[LANES + j])
                d = max(c, key[2 * LANES + j])
                key[2 * LANES + j] = min(c, key[2 * LANES + j])
                key[3 * LANES + j] = min(d, key[3 * LANES + j])
        else:
            for j in range(lanes):
                dx, dy, dz = qx - lane[j], qy - lane[LANES + j], qz - lane[2 * LANES + j]
                a = (bits(dx * dx + dy * dy + dz * dz) & ~PLACE) | k
                b = max(a, key[j])
                key[j] = min(a, key[j])
                c = max(b, key[LANES + j])
                key[LANES + j] = min(b, key[LANES + j])
                d = max(c, key[2 * LANES + j])
                key[2 * LANES + j] = min(c, key[2 * LANES + j])
                e = max(d, key[3 * LANES + j])
                key[3 * LANES + j] = min(d, key[3 * LANES + j])
                f = max(e, key[4 * LANES + j])
                key[4 * LANES + j] = min(e, key[4 * LANES + j])
                key[5 * LANES + j] = min(f, key[5 * LANES + j])


@jit
def _scan(tree, candidates, x, y, z, matches, found, distance):
    """The k nearest candidates by full distances, lowest index on ties."""
    for t in range(matches):
        found[t] = -1
        distance[t] = np.inf
    for k in range(candidates.shape[0]):
        q = candidates[k]
        dx, dy, dz = tree.points[q, 0] - x, tree.points[q, 1] - y, tree.points[q, 2] - z
        d2 = dx * dx + dy * dy + dz * dz
        if d2 <= distance[matches - 1]:
            kdtree.insert(found, distance, matches, q, d2, tree.index)


@jit
def _match_group(tree, candidates, queries, work, matches, found, distance):
    """Match the queries that share one list."""
    points, lane, key = tree.points, work.lane, work.key
    for first in range(0, queries.shape[0], LANES):
        lanes = min(LANES, queries.shape[0] - first)
        padded = (lanes + 7) & ~7
        for j in range(padded):
            i = queries[first + min(j, lanes - 1)]
            lane[j] = work.x[i]
            lane[LANES + j] = work.y[i]
            lane[2 * LANES + j] = work.z[i]
        _smallest_keys(points, candidates, lane, key, padded, matches)
        for j in range(lanes):
            i = queries[first + j]
            x, y, z = lane[j], lane[LANES + j], lane[2 * LANES + j]
            tied = False
            for t in range(matches):
                this = key[t * LANES + j]
                tied |= (this ^ key[(t + 1) * LANES + j]) <= PLACE
                q = candidates[this & PLACE]
                dx, dy, dz = points[q, 0] - x, points[q, 1] - y, points[q, 2] - z
                found[i * matches + t] = q
                distance[i * matches + t] = dx * dx + dy * dy + dz * dz
            if tied:
                link = i * matches
                _scan(
                    tree,
                    candidates,
                    x,
                    y,
                    z,
                    matches,
                    found[link : link + matches],
                    distance[link : link + matches],
                )


@jit
def match(tree, lists, matches, limit, count, work, found, distance, stack):
    """The k nearest reference points of the first `count` queries of `work`.

    found, distance: (count * matches,) position in tree order, squared distance [m^2]; ascending.
    A link longer than the square root of `limit` is -1, infinity.
    """
    where, order = work.where, work.order
    group_list, group_end = work.group_list, work.group_end
    records = lists.records
    locate(tree, lists, matches, work.x, work.y, work.z, count, where)
    groups = 0
    for i in range(count):
        record = where[i]
        if record < 0:
            link = i * matches
            kdtree.nearest(
                tree,
                work.x[i],
                work.y[i],
                work.z[i],
                matches,
                np.inf,
                found[link : link + matches],
                distance[link : link + matches],
                stack,
            )
            continue
        group = records[record + 2]
        if group < 0:
            group = groups
            records[record + 2] = group
            group_list[group] = record
            group_end[group] = 0
            groups += 1
        group_end[group] += 1
        where[i] = group
    begin = 0
    for group in range(groups):
        size = group_end[group]
        group_end[group] = begin
        begin += size
    for i in range(count):
        group = where[i]
        if group >= 0:
            order[group_end[group]] = i
            group_end[group] += 1
    begin = 0
    for group in range(groups):
        record = group_list[group]
        records[record + 2] = -1
        end = group_end[group]
        candidates = records[record + HEADER : record + HEADER + records[record]]
        if candidates.shape[0] <= PACKED:
            _match_group(tree, candidates, order[begin:end], work, matches, found, distance)
        else:
            for k in range(begin, end):
                i = order[k]
                link = i * matches
                _scan(
                    tree,
                    candidates,
                    work.x[i],
                    work.y[i],
                    work.z[i],
                    matches,
                    found[link : link + matches],
                    distance[link : link + matches],
                )
        begin = end
    if limit < np.inf:
        for link in range(count * matches):
            if distance[link] > limit:
                found[link] = -1
                distance[link] = np.inf
