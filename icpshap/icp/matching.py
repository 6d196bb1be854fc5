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

from typing import NamedTuple

import numpy as np

from icpshap.icp import kdtree, keys
from icpshap.icp.candidates import HEADER, SHORT, WORTH_SPLITTING, Lists, divide, locate
from icpshap.icp.compiled import Array, jit, jit_borrowing
from icpshap.icp.intrinsics import prefetch
from icpshap.icp.network import LANES, LONGEST, PLACE, nearest_five, nearest_one, nearest_three

GROUPS_AHEAD = 6  # groups before a list is read, it is asked for
LINES_AHEAD = 5  # cache lines of it
LINKS_AHEAD = 24  # links before a point is read, it is asked for


class Work(NamedTuple):
    """Arrays for queries that are matched together."""

    x: Array  # (n + TOGETHER + 1,) queries [m]; the last one is none
    y: Array
    z: Array
    # (n * matches + TOGETHER,) int64: key of each link's length in the upper half, reference point
    # (tree order; -1 for none within the limit) in the lower; ascending for each query
    links: Array
    where: Array  # (n,) int32 record of each query's list; later its group
    # (n + LANES, 4) float32 queries sorted by group: x, y, z [m]; the bits of their numbers
    ordered: Array
    group_list: Array  # (n,) int32 record of each group
    group_end: Array  # (n,) int32 end of each group in `ordered`
    nearest: Array  # (6 LANES,) int32 keys of the nearest, one row of LANES for each rank


def work_arrays(queries: int, matches: int) -> Work:
    """Work for up to that many queries."""
    # One place more than a pass over several links can write behind the last query.
    x, y, z = (np.zeros(queries + keys.TOGETHER + 1) for _ in range(3))
    where, group_list, group_end = (np.empty(queries, dtype=np.int32) for _ in range(3))
    # The lanes behind the last query of a group are computed and ignored: they must exist.
    ordered = np.zeros((queries + LANES, 4), dtype=np.float32)
    nearest = np.zeros(6 * LANES, dtype=np.int32)
    links = np.zeros(queries * matches + keys.TOGETHER, dtype=np.int64)
    return Work(x, y, z, links, where, ordered, group_list, group_end, nearest)


@jit_borrowing
def move(
    points: Array, positions: Array, T: Array, run: int, x: Array, y: Array, z: Array, begin: int
) -> int:
    """Points of some positions, moved by T[run], to x, y, z from `begin` on; returns how many."""
    r00, r01, r02, tx = T[run, 0, 0], T[run, 0, 1], T[run, 0, 2], T[run, 0, 3]
    r10, r11, r12, ty = T[run, 1, 0], T[run, 1, 1], T[run, 1, 2], T[run, 1, 3]
    r20, r21, r22, tz = T[run, 2, 0], T[run, 2, 1], T[run, 2, 2], T[run, 2, 3]
    for k in range(len(positions)):
        # Unsigned, or numba would ask of each index whether it counts from the end.
        p, i = np.uint64(positions[np.uint64(k)]), np.uint64(begin + k)
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        x[i] = r00 * px + r01 * py + r02 * pz + tx
        y[i] = r10 * px + r11 * py + r12 * pz + ty
        z[i] = r20 * px + r21 * py + r22 * pz + tz
    return len(positions)


@jit_borrowing
def squared_distance(points: Array, q: int, x: float, y: float, z: float) -> float:
    """From (x, y, z) to points[q] [m^2], by the operations of the k-d tree."""
    dx, dy, dz = points[q, 0] - x, points[q, 1] - y, points[q, 2] - z
    return dx * dx + dy * dy + dz * dz


@jit_borrowing
def scan(lists: Lists, work: Work, i: int, candidates: Array) -> None:
    """Links of query i to the nearest candidates by full distances, the lowest row first."""
    points, rows, x, y, z = lists.tree.points, lists.tree.rows, work.x[i], work.y[i], work.z[i]
    found, distance = lists.best[: lists.matches], lists.best_distance[: lists.matches]
    found[:] = -1
    distance[:] = np.inf
    for k in range(candidates.shape[0]):
        q = candidates[np.uint64(k)]
        d2 = squared_distance(points, np.uint64(q), x, y, z)
        if d2 <= distance[-1]:
            kdtree.insert(found, distance, q, d2, rows)
    _write_links(work, i, found, distance)


@jit_borrowing
def _search(lists, work, i, limit):
    """Links of query i by the tree."""
    x, y, z = work.x[i], work.y[i], work.z[i]
    found, distance = lists.best[: lists.matches], lists.best_distance[: lists.matches]
    kdtree.nearest(lists.tree, x, y, z, limit, found, distance, lists.stack)
    _write_links(work, i, found, distance)


@jit_borrowing
def _write_links(work, i, found, distance):
    matches = found.shape[0]
    for t in range(matches):
        made = found[t] >= 0 and distance[t] < np.inf
        key = np.float32(min(distance[t], keys.LARGEST)).view(np.int32) if made else keys.NEVER
        work.links[np.int64(i) * matches + t] = _link(key, found[t])


@jit
def _link(key, found):
    return np.int64(key) << 32 | np.int64(np.uint32(found))


@jit_borrowing
def sort_by_list(records: Array, count: int, work: Work) -> int:
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


@jit_borrowing
def visit(lists: Lists, work: Work, group: int, groups: int, queries: int) -> tuple[int, int]:
    """Record of a group's list, which so many queries are about to read, and its length.

    The cube is split once that pays, and lists that are read soon are asked for.
    """
    records, group_list = lists.records, work.group_list
    for line in range(LINES_AHEAD):
        prefetch(records, group_list[min(group + GROUPS_AHEAD, groups - 1)] + 16 * line)
    record = np.int64(group_list[group])
    length = records[record]
    if length > SHORT:
        scanned = records[record + 1] + length * queries
        if records[record + 1] < WORTH_SPLITTING <= scanned:
            divide(lists, record)
        records[record + 1] = min(scanned, WORTH_SPLITTING)
    return record, length


@jit
def match(lists: Lists, limit: float, count: int, work: Work) -> None:
    """Links of the first `count` queries of `work` to their k nearest reference points.

    A link is left out only if it is longer than the square root of `limit`; some that are may stay.
    """
    locate(lists, work.x, work.y, work.z, count, work.where)
    _read_lists(lists, limit, count, work, np.empty(5, np.int32))


@jit_borrowing
def _read_lists(lists, limit, count, work, few):
    # Named once: taking an array out of a tuple, or a slice of one, costs more than a distance.
    matches, largest, records, coarse = lists.matches, lists.largest, lists.records, lists.coarse
    where, ordered, links, nearest = work.where, work.ordered, work.links, work.nearest
    number, group_end = ordered.view(np.int32), work.group_end
    few = few[: 1 if matches == 1 else 3 if matches <= 3 else 5]
    for i in range(count):
        if where[i] < 0:
            _search(lists, work, np.uint64(i), limit)
    groups = sort_by_list(records, count, work)
    begin = 0
    for group in range(groups):
        end = group_end[group]
        record, length = visit(lists, work, group, groups, end - begin)
        first = record + HEADER
        if length > LONGEST:
            for row in range(begin, end):
                _search(lists, work, np.uint64(number[row, 3]), limit)
            begin = end
        while begin < end:
            queries = (coarse, records, first, length, ordered, begin, largest, nearest)
            if matches == 1:
                undecided, unordered = nearest_one(*queries)
            elif matches <= 3:
                undecided, unordered = nearest_three(*queries)
            else:
                undecided, unordered = nearest_five(*queries)
            for lane in range(min(LANES, end - begin)):
                row = np.uint64(begin + lane)
                i = np.uint64(number[row, 3])
                if undecided >> np.uint64(lane) & np.uint64(1):
                    scan(lists, work, i, records[first : first + length])
                elif unordered >> np.uint64(lane) & np.uint64(1):
                    for t in range(len(few)):
                        few[t] = records[first + (nearest[t * LANES + lane] & PLACE)]
                    scan(lists, work, i, few)
                else:
                    link = i * np.uint64(matches)
                    for t in range(matches):
                        key = nearest[np.uint64(t * LANES + lane)]
                        entry = np.uint64(first) + np.uint64(key & PLACE)
                        links[link] = _link(key, records[entry])
                        link += np.uint64(1)
            begin += LANES
        begin = end


@jit_borrowing
def measure(
    lists: Lists, limit: float, count: int, work: Work, found: Array, distance: Array
) -> None:
    """Reference points and squared lengths [m^2] of the first `count` queries' links.

    found, distance: (count * matches,); -1 and infinity for those longer than the square root of
    `limit`.
    """
    # In the order of the queries, which streams; it is known which points to ask for in advance.
    points, matches, links = lists.tree.points, lists.matches, work.links
    last = count * matches - 1
    for i in range(count):
        x, y, z = work.x[i], work.y[i], work.z[i]
        for link in range(i * matches, (i + 1) * matches):
            prefetch(points, 4 * np.int64(np.int32(links[min(link + LINKS_AHEAD, last)])))
            q = np.int32(links[link])
            d2 = squared_distance(points, np.uint64(q), x, y, z) if q >= 0 else np.inf
            found[link] = q if d2 <= limit else -1
            distance[link] = d2 if d2 <= limit else np.inf
