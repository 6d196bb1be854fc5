"""Matching: the k nearest reference points of many neighbouring queries.

Idea: the queries of a neighbourhood, all runs together, are sorted by candidate list, in linear
time. Each list is then read once for all the queries in its cube, sixteen queries at a time
(`network`).

Exactness: the network orders candidates in single precision and tells for which queries it is
sure of the nearest, and of their order; for the others full distances decide, equal ones by lowest
index. The k-d tree answers the queries outside the lists, and those whose list is too long for the
network: which way a query is answered cannot be seen in the reference points that are found. Their
distances are the network's keys, or full distances rounded to such; `keys` says up to which key a
full distance is surely shorter than a bound, and from which one it is not, whichever way it was
found.

Measured: docs/engine.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icpshap.icp import kdtree, keys
from icpshap.icp.candidates import HEADER, SHORT, WORTH_SPLITTING, divide, locate
from icpshap.icp.compiled import jit, jit_borrowing
from icpshap.icp.intrinsics import prefetch
from icpshap.icp.network import (
    LANES,
    LONGEST,
    PLACE,
    nearest_five,
    nearest_one,
    nearest_three,
)

if TYPE_CHECKING:
    from icpshap.icp.candidates import Lists


GROUPS_AHEAD = 6  # groups before a list is read, it is asked for
LINES_AHEAD = 5  # cache lines of it
LINKS_AHEAD = 24  # links before a point is read, it is asked for


class Work(NamedTuple):
    """Arrays for queries that are matched together."""

    x: np.ndarray  # (n + TOGETHER + 1,) queries [m]; the last one is none
    y: np.ndarray
    z: np.ndarray
    # (n * matches + TOGETHER,) int64: key of each link's length in the upper half, reference point
    # (tree order; -1 for none within the limit) in the lower; ascending for each query
    links: np.ndarray
    where: np.ndarray  # (n,) int32 record of each query's list; later its group
    # (n + LANES, 4) float32 queries sorted by group: x, y, z [m]; the bits of their numbers
    ordered: np.ndarray
    group_list: np.ndarray  # (n,) int32 record of each group
    group_end: np.ndarray  # (n,) int32 end of each group in `ordered`
    nearest: np.ndarray  # (5 LANES,) int32 keys of the nearest, one row of LANES for each rank


def work_arrays(queries: int, matches: int) -> Work:
    """Work for up to that many queries."""
    # One place more than a pass over several links can write behind the last query.
    x, y, z = (np.zeros(queries + keys.TOGETHER + 1) for _ in range(3))
    where, group_list, group_end = (np.empty(queries, dtype=np.int32) for _ in range(3))
    # The lanes behind the last query of a group are computed and ignored: they must exist.
    ordered = np.zeros((queries + LANES, 4), dtype=np.float32)
    nearest = np.zeros(5 * LANES, dtype=np.int32)
    links = np.zeros(queries * matches + keys.TOGETHER, dtype=np.int64)
    return Work(x, y, z, links, where, ordered, group_list, group_end, nearest)


@jit_borrowing
def squared_distance(points: np.ndarray, q: int, x: float, y: float, z: float) -> float:
    """From (x, y, z) to points[q] [m^2], by the operations of the k-d tree."""
    dx, dy, dz = points[q, 0] - x, points[q, 1] - y, points[q, 2] - z
    return dx * dx + dy * dy + dz * dz


@jit_borrowing
def _scan(points, index, records, first, count, x, y, z, matches, found, distance):
    """The k nearest of a list by full distances, lowest index on ties."""
    for t in range(matches):
        found[t] = -1
        distance[t] = np.inf
    for k in range(count):
        q = records[np.uint64(first + k)]
        d2 = squared_distance(points, np.uint64(q), x, y, z)
        if d2 <= distance[matches - 1]:
            kdtree.insert(found, distance, q, d2, index)


@jit
def _link(key, found):
    return np.int64(key) << 32 | np.int64(np.uint32(found))


@jit_borrowing
def _write_links(matches, found, distance, links, first):
    """Links out of full distances."""
    for t in range(matches):
        made = found[t] >= 0 and distance[t] < np.inf
        key = np.float32(min(distance[t], keys.LARGEST)).view(np.int32) if made else keys.NEVER
        links[first + t] = _link(key, found[t])


@jit_borrowing
def _sort_by_list(records, count, work):
    """Sort the queries with a list by list, in linear time; returns the number of groups."""
    x, y, z, where, ordered = work.x, work.y, work.z, work.where, work.ordered
    group_list, group_end = work.group_list, work.group_end
    number = ordered.view(np.int32)
    groups = 0
    # Unsigned, here and below, or numba would ask of each index whether it counts from the end.
    for i in range(count):
        if where[i] < 0:
            continue
        mark = np.uint64(where[i]) + np.uint64(2)
        if records[mark] < 0:
            records[mark] = groups
            group_list[groups] = where[i]
            group_end[groups] = 0
            groups += 1
        where[i] = records[mark]
        group_end[np.uint64(where[i])] += 1
    begin = 0
    for group in range(groups):
        records[group_list[group] + 2] = -1
        size = group_end[group]
        group_end[group] = begin
        begin += size
    for i in range(count):
        if where[i] < 0:
            continue
        group = np.uint64(where[i])
        row = np.uint64(group_end[group])
        group_end[group] += 1
        ordered[row, 0], ordered[row, 1], ordered[row, 2] = x[i], y[i], z[i]
        number[row, 3] = i
    return groups


@jit
def match(
    tree: kdtree.Tree, lists: Lists, matches: int, limit: float, count: int, work: Work
) -> None:
    """Links of the first `count` queries of `work` to their k nearest reference points.

    A link is left out only if it is longer than the square root of `limit`; some that are may stay.
    """
    # Named once: taking an array out of a tuple, or a slice of one, costs more than a distance.
    largest = lists.largest
    points, index, records, coarse = tree.points, tree.rows, lists.records, lists.coarse
    qx, qy, qz, where, ordered = work.x, work.y, work.z, work.where, work.ordered
    group_list, group_end, links = work.group_list, work.group_end, work.links
    nearest = work.nearest
    number = ordered.view(np.int32)
    stack = np.empty(kdtree.STACK, np.int32)
    found = np.empty(matches, np.int32)
    distance = np.empty(matches)
    few = np.empty(1 if matches == 1 else 3 if matches <= 3 else 5, np.int32)
    locate(tree, lists, matches, qx, qy, qz, count, where)
    for i in range(count):
        if where[i] < 0:
            kdtree.nearest(tree, qx[i], qy[i], qz[i], limit, found, distance, stack)
            _write_links(matches, found, distance, links, i * matches)
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
                i = number[row, 3]
                kdtree.nearest(tree, qx[i], qy[i], qz[i], limit, found, distance, stack)
                link = np.int64(i) * matches
                _write_links(matches, found, distance, links, link)
            begin = end
        while begin < end:
            if matches == 1:
                undecided, unordered = nearest_one(
                    coarse, records, first, length, ordered, begin, largest, nearest
                )
            elif matches <= 3:
                undecided, unordered = nearest_three(
                    coarse, records, first, length, ordered, begin, largest, nearest
                )
            else:
                undecided, unordered = nearest_five(
                    coarse, records, first, length, ordered, begin, largest, nearest
                )
            for lane in range(min(LANES, end - begin)):
                row = np.uint64(begin + lane)
                i = np.uint64(number[row, 3])
                link = i * np.uint64(matches)
                if (undecided | unordered) >> np.uint64(lane) & np.uint64(1):
                    x, y, z = qx[i], qy[i], qz[i]
                    if undecided >> np.uint64(lane) & np.uint64(1):
                        _scan(
                            *(points, index, records, first, length),
                            *(x, y, z, matches, found, distance),
                        )
                    else:
                        for t in range(len(few)):
                            few[t] = records[first + (nearest[t * LANES + lane] & PLACE)]
                        _scan(
                            *(points, index, few, 0, len(few)),
                            *(x, y, z, matches, found, distance),
                        )
                    _write_links(matches, found, distance, links, link)
                    continue
                for t in range(matches):
                    key = nearest[np.uint64(t * LANES + lane)]
                    entry = np.uint64(first) + np.uint64(key & PLACE)
                    links[link] = _link(key, records[entry])
                    link += np.uint64(1)
            begin += LANES
        begin = end


@jit_borrowing
def measure(
    points: np.ndarray,
    limit: float,
    count: int,
    matches: int,
    work: Work,
    found: np.ndarray,
    distance: np.ndarray,
) -> None:
    """Reference points and squared lengths [m^2] of the first `count` queries' links.

    found, distance: (count * matches,); -1 and infinity for those longer than the square root of
    `limit`.
    """
    # In the order of the queries, which streams; it is known which points to ask for in advance.
    links = work.links
    last = count * matches - 1
    for i in range(count):
        x, y, z = work.x[i], work.y[i], work.z[i]
        for link in range(i * matches, (i + 1) * matches):
            prefetch(points, 4 * np.int64(np.int32(links[min(link + LINKS_AHEAD, last)])))
            q = np.int32(links[link])
            d2 = squared_distance(points, np.uint64(q), x, y, z) if q >= 0 else np.inf
            found[link] = q if d2 <= limit else -1
            distance[link] = d2 if d2 <= limit else np.inf
