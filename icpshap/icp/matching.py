"""Matching: the k nearest reference points of many neighbouring queries.

Idea: the queries of a neighbourhood, all runs together, are sorted by candidate list, in linear
time. Each list is then read once for all the queries in its cube, sixteen queries at a time
(`network`).

Exactness: the network orders candidates in single precision and tells for which queries it is
sure of the order; the others are repeated with full distances, equal ones by lowest index. All
distances that are passed on are computed by the same operations as in the k-d tree, which answers
the queries outside the lists, and those whose list is too long for the network: which way a query
is answered cannot be seen in the result.

Measured: docs/engine.md.
"""

from typing import NamedTuple

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.candidates import HEADER, SHORT, WORTH_SPLITTING, divide, locate
from icpshap.icp.compiled import jit, prefetch
from icpshap.icp.network import LANES, LONGEST, nearest_five, nearest_one, nearest_three

GROUPS_AHEAD = 6  # groups before a list is read, it is asked for
LINES_AHEAD = 5  # cache lines of it
LINKS_AHEAD = 24  # links before a point is read, it is asked for


class Work(NamedTuple):
    """Arrays for queries that are matched together."""

    x: np.ndarray  # (n,) queries [m]
    y: np.ndarray
    z: np.ndarray
    where: np.ndarray  # (n,) int32 record of each query's list; later its group
    ordered: np.ndarray  # (n + LANES, 4) x, y, z [m] and number of the queries, sorted by group
    group_list: np.ndarray  # (n,) int32 record of each group
    group_end: np.ndarray  # (n,) int32 end of each group in `ordered`
    place: np.ndarray  # (5 LANES,) int32 nearest candidates, one row of LANES for each rank


def work_arrays(queries):
    """Work for up to that many queries."""
    coordinates = [np.empty(queries) for _ in range(3)]
    where, group_list, group_end = (np.empty(queries, dtype=np.int32) for _ in range(3))
    # The lanes behind the last query of a group are computed and ignored: they must exist.
    ordered = np.zeros((queries + LANES, 4))
    place = np.zeros(5 * LANES, dtype=np.int32)
    return Work(*coordinates, where, ordered, group_list, group_end, place)


@jit
def _squared_distance(points, q, x, y, z):
    dx, dy, dz = points[q, 0] - x, points[q, 1] - y, points[q, 2] - z
    return dx * dx + dy * dy + dz * dz


@jit
def _scan(points, index, records, first, count, query, matches, found, distance, link):
    """The k nearest of a list by full distances, lowest index on ties, from entry `link` on."""
    for t in range(link, link + matches):
        found[t] = -1
        distance[t] = np.inf
    for k in range(count):
        q = records[first + k]
        d2 = _squared_distance(points, q, query[0], query[1], query[2])
        if d2 <= distance[link + matches - 1]:
            kdtree.insert(found, distance, link, matches, q, d2, index)


@jit
def _sort_by_list(records, count, work):
    """Sort the queries with a list by list, in linear time; returns the number of groups."""
    x, y, z, where, ordered = work.x, work.y, work.z, work.where, work.ordered
    group_list, group_end = work.group_list, work.group_end
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
            row = group_end[group]
            ordered[row, 0], ordered[row, 1], ordered[row, 2] = x[i], y[i], z[i]
            ordered[row, 3] = i
            group_end[group] = row + 1
    return groups


@jit
def match(tree, lists, matches, limit, count, work, found, distance, stack):
    """The k nearest reference points of the first `count` queries of `work`.

    found, distance: (count * matches,) position in tree order, squared distance [m^2]; ascending.
    A link longer than the square root of `limit` is -1, infinity.
    """
    # Named once: taking an array out of a tuple, or a slice of one, costs more than a distance.
    largest = lists.largest
    points, index, records, coarse = tree.points, tree.index, lists.records, lists.coarse
    qx, qy, qz, where, ordered = work.x, work.y, work.z, work.where, work.ordered
    group_list, group_end, place = work.group_list, work.group_end, work.place
    locate(tree, lists, matches, qx, qy, qz, count, where)
    for i in range(count):
        if where[i] < 0:
            kdtree.nearest(
                tree, qx[i], qy[i], qz[i], matches, limit, found, distance, i * matches, stack
            )
    groups = _sort_by_list(records, count, work)
    begin = 0
    for group in range(groups):
        for line in range(LINES_AHEAD):
            prefetch(records, group_list[min(group + GROUPS_AHEAD, groups - 1)] + 16 * line)
        record = group_list[group]
        first, length = record + HEADER, records[record]
        end = group_end[group]
        if length > SHORT:
            scanned = records[record + 1] + length * (end - begin)
            if records[record + 1] < WORTH_SPLITTING <= scanned:
                divide(lists, record)
            records[record + 1] = min(scanned, WORTH_SPLITTING)
        if length > LONGEST:
            for row in range(begin, end):
                x, y, z = ordered[row, 0], ordered[row, 1], ordered[row, 2]
                link = np.int64(ordered[row, 3]) * matches
                kdtree.nearest(tree, x, y, z, matches, limit, found, distance, link, stack)
            begin = end
        while begin < end:
            if matches == 1:
                undecided = nearest_one(
                    coarse, records, first, length, ordered, begin, largest, place
                )
            elif matches <= 3:
                undecided = nearest_three(
                    coarse, records, first, length, ordered, begin, largest, place
                )
            else:
                undecided = nearest_five(
                    coarse, records, first, length, ordered, begin, largest, place
                )
            for lane in range(min(LANES, end - begin)):
                # Unsigned, or numba would ask of each index whether it counts from the end.
                row = np.uint64(begin + lane)
                link = np.uint64(ordered[row, 3]) * np.uint64(matches)
                if undecided >> np.uint64(lane) & np.uint64(1):
                    query = ordered[row]
                    _scan(
                        points, index, records, first, length, query, matches, found, distance, link
                    )
                    continue
                for t in range(matches):
                    entry = np.uint64(first) + np.uint64(place[t * LANES + lane])
                    found[link] = records[entry]
                    link += np.uint64(1)
            begin += LANES
        begin = end
    # Full distances in the order of the queries, which streams, and only now, when it is known
    # which points to ask for in advance.
    last = count * matches - 1
    for i in range(count):
        x, y, z = qx[i], qy[i], qz[i]
        for link in range(i * matches, (i + 1) * matches):
            prefetch(points, 4 * found[min(link + LINKS_AHEAD, last)])
            q = found[link]
            d2 = _squared_distance(points, np.uint64(q), x, y, z) if q >= 0 else np.inf
            if d2 > limit:
                found[link] = -1
                d2 = np.inf
            distance[link] = d2
