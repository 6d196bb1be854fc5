"""Matching: the k nearest reference points of a block of queries.

Idea: the queries of a block, all runs together, are sorted by candidate list, in linear time. Each
list is then read once for all the queries in its cube, eight queries at a time (`network`).

Exactness: the network orders squared distances without their last 8 bits, so it keeps one more
than k; whenever two neighbours in that order agree in all other bits, the query is repeated with
full distances, equal ones by lowest index. Distances are computed by the same operations as in the
k-d tree, which answers the queries outside the lists: which way a query is answered cannot be seen
in the result.

Measured: docs/engine.md.
"""

from typing import NamedTuple

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.candidates import HEADER, locate
from icpshap.icp.compiled import jit
from icpshap.icp.network import (
    LANES,
    LONGEST,
    PLACE,
    four_smallest_keys,
    six_smallest_keys,
    two_smallest_keys,
)


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
    lane, key = np.zeros(3 * LANES), np.zeros(6 * LANES, dtype=np.int64)
    return Work(*coordinates, *integers, lane, key)


@jit
def _squared_distance(points, q, x, y, z):
    dx, dy, dz = points[q, 0] - x, points[q, 1] - y, points[q, 2] - z
    return dx * dx + dy * dy + dz * dz


@jit
def _scan(points, index, records, first, count, x, y, z, matches, found, distance, link):
    """The k nearest of a list by full distances, lowest index on ties, from entry `link` on."""
    for t in range(link, link + matches):
        found[t] = -1
        distance[t] = np.inf
    for k in range(count):
        q = records[first + k]
        d2 = _squared_distance(points, q, x, y, z)
        if d2 <= distance[link + matches - 1]:
            kdtree.insert(found, distance, link, matches, q, d2, index)


@jit
def _sort_by_list(records, count, where, order, group_list, group_end):
    """Sort the queries with a list by list, in linear time; returns the number of groups."""
    groups = 0
    for i in range(count):
        record = where[i]
        if record < 0:
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
        records[group_list[group] + 2] = -1
        size = group_end[group]
        group_end[group] = begin
        begin += size
    for i in range(count):
        group = where[i]
        if group >= 0:
            order[group_end[group]] = i
            group_end[group] += 1
    return groups


@jit
def match(tree, lists, matches, limit, count, work, found, distance, stack):
    """The k nearest reference points of the first `count` queries of `work`.

    found, distance: (count * matches,) position in tree order, squared distance [m^2]; ascending.
    A link longer than the square root of `limit` is -1, infinity.
    """
    # Named once: taking an array out of a tuple, or a slice of one, costs more than a distance.
    points, index, records = tree.points, tree.index, lists.records
    qx, qy, qz, where, order = work.x, work.y, work.z, work.where, work.order
    group_list, group_end = work.group_list, work.group_end
    lane, key = work.lane, work.key
    locate(tree, lists, matches, qx, qy, qz, count, where)
    for i in range(count):
        if where[i] < 0:
            kdtree.nearest(
                tree, qx[i], qy[i], qz[i], matches, limit, found, distance, i * matches, stack
            )
    groups = _sort_by_list(records, count, where, order, group_list, group_end)
    begin = 0
    for group in range(groups):
        first = group_list[group] + HEADER
        length = records[group_list[group]]
        end = group_end[group]
        while begin < end:
            lanes = min(LANES, end - begin)
            if length <= LONGEST:
                for j in range(LANES):
                    i = order[begin + min(j, lanes - 1)]
                    lane[j], lane[LANES + j], lane[2 * LANES + j] = qx[i], qy[i], qz[i]
                if matches == 1:
                    two_smallest_keys(points, records, first, length, lane, key)
                elif matches <= 3:
                    four_smallest_keys(points, records, first, length, lane, key)
                else:
                    six_smallest_keys(points, records, first, length, lane, key)
            for j in range(lanes):
                i = order[begin + j]
                x, y, z = qx[i], qy[i], qz[i]
                link = i * matches
                tied = length > LONGEST
                if not tied:
                    for t in range(matches):
                        this = key[t * LANES + j]
                        tied |= (this ^ key[(t + 1) * LANES + j]) <= PLACE
                        q = records[first + (this & PLACE)]
                        found[link + t] = q
                        distance[link + t] = _squared_distance(points, q, x, y, z)
                if tied:
                    _scan(
                        points,
                        index,
                        records,
                        first,
                        length,
                        x,
                        y,
                        z,
                        matches,
                        found,
                        distance,
                        link,
                    )
            begin += lanes
    if limit < np.inf:
        for link in range(count * matches):
            if found[link] < 0 or distance[link] > limit:
                found[link] = -1
                distance[link] = np.inf
