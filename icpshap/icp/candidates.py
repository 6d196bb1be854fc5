"""Candidate lists: for a cube of space, every point that can be among the k nearest of some query.

Idea (after Drost and Ilic, Machine Vision and Applications 29, 2018): cut space into cubes; a
query reads its cube's list, some forty points, and never walks a tree. A cube is filled when a
query first falls into it, from the list of the cube around it; nine sizes of cube, each half the
one above, so that crowded space is cut finer. A cube is split only while its list is long, and only
once so many candidates have been scanned in it that the split will pay, which bounds the time and
the memory of filling.

Where very many points lie closer together than any cube can tell apart, lists are long whatever is
filled. So filling has a budget, a fixed number of candidates for each reference point and for each
query, which ordinary scans use by less than half; beyond it, and wherever a list is too long for
the network, the tree answers, whose time such points do not change. Of coincident points, only
those with the lowest indices enter a list at all.

Exactness: let c be the cube's centre and e half its side. Point s is nearer than q to *every* x of
the cube if |q-c|^2 - |s-c|^2 > 2 e |q-s|_1, a half-space that contains a box. A point is dropped
only if k others are nearer to every x in this sense (with a margin far above rounding), so no
list ever misses one of the k nearest, equal distances included. The lists therefore shorten the
search and cannot change its result: they may be shared by runs in any order.

Measured: docs/engine.md.
"""

import math
from typing import NamedTuple

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.compiled import Array, jit, jit_borrowing
from icpshap.icp.intrinsics import prefetch
from icpshap.icp.network import LONGEST

UNFILLED = 0
LARGEST_INDEX = 2**31 - 1
ROOM_POINT = 300  # integers of lists for each reference point
LARGEST_ROOM = 2**29  # and at most in all (2 GB), beyond which the tree answers what is not listed
SIDE = 12.0  # of the coarsest cubes, in median distances to the sixth neighbour
COARSEST_CUBES = 2**22  # at most about this many; larger cubes where space is mostly empty
LEVELS = 9  # sizes of cubes, each half the one above
SHORT = 64  # a list this short is never split
WORTH_SPLITTING = 131_072  # candidates scanned in a cube before it is split
DOMINATORS = 16  # points beyond the k nearest to the centre that are tried as the nearer point
PORTIONS = (2, DOMINATORS)  # of them, beyond the k nearest, after which the rest is compacted
HEADER = 8  # numbers before a record's points: length, candidates scanned, group, cell, CUBE
CUBE = 4  # place of a record's cube: centre and half side [m], the bits of float32
TOGETHER = 64  # queries located together
BUDGET_POINT = 1024  # candidates that fills may read, for each reference point
BUDGET_QUERY = 256  # and for each query until then


class Lists(NamedTuple):
    """Cubes and their lists for one reference and one number of matches."""

    tree: kdtree.Tree
    matches: int
    origin: Array  # (3,) lower corner of the cubed box [m]
    shape: Array  # (3,) int64 number of coarsest cubes along each axis
    side: Array  # (1,) side of the coarsest cubes [m]
    # int32: coarsest cubes, then 8 children each; UNFILLED, first child or -1 - record of the list
    cells: np.ndarray
    parent: Array  # int32: list of the cube that each 8 children divide
    records: Array  # int32: the lists, HEADER and positions in tree order
    coarse: Array  # (n, 4) float32 points in tree order
    largest: float  # coordinate of any point or query in the cubed box [m]
    # (4,) int64: cells and record integers in use, candidates read by fills, queries located
    used: np.ndarray
    stack: Array  # for searches in the tree
    best: Array  # (matches + DOMINATORS,) int32 points nearest to a cube's centre
    best_distance: Array  # and their squared distances from it [m^2]
    scratch: Array  # (n,) int32 candidates of a coarsest cube
    columns: Array  # (4, n) their x, y, z [m] and squared distance to the cube's centre
    nearer: Array  # (n,) int64 points known to be nearer to the whole cube


def empty_lists(tree: kdtree.Tree, matches: int) -> Lists:
    """Lists without content; memory is touched only as they fill."""
    n = len(tree.points)
    low, high = tree.box[1, :3], tree.box[1, 3:]
    size = np.linalg.norm(high - low)
    spacing = np.median(kdtree.neighbour_distances(tree, min(7, n), 1000))
    margin = 0.1 * size + 1e-3
    extent = high - low + 2 * margin
    side = max(SIDE * spacing, np.cbrt(np.prod(extent) / COARSEST_CUBES))
    shape = np.ceil(extent / side).astype(np.int64)
    coarsest = int(np.prod(shape))
    cells = np.zeros(min(coarsest + 8 * (8000 + 16 * n), LARGEST_INDEX), dtype=np.int32)
    return Lists(
        tree=tree,
        matches=matches,
        origin=low - margin,
        shape=shape,
        side=np.array([side]),
        cells=cells,
        parent=np.empty((len(cells) - coarsest) // 8, dtype=np.int32),
        records=np.empty(min(1_000_000 + ROOM_POINT * n, LARGEST_ROOM), dtype=np.int32),
        coarse=tree.points.astype(np.float32),
        largest=float(np.abs([low - margin, low - margin + shape * side]).max()),
        used=np.array([coarsest, 0, 0, 0]),
        stack=np.empty(kdtree.STACK, dtype=np.int32),
        best=np.empty(matches + DOMINATORS, dtype=np.int32),
        best_distance=np.empty(matches + DOMINATORS),
        scratch=np.empty(n, dtype=np.int32),
        columns=np.empty((4, n)),
        nearer=np.empty(n, dtype=np.int64),
    )


@jit_borrowing
def _fill(lists, cell, cx, cy, cz, half, candidates):
    """Write the list of the cube (centre, half side) out of `candidates`; returns its record."""
    points, records, used, nearer = lists.tree.points, lists.records, lists.used, lists.nearer
    matches, best, best_distance = lists.matches, lists.best, lists.best_distance
    x, y, z, distance = lists.columns[0], lists.columns[1], lists.columns[2], lists.columns[3]
    count = candidates.shape[0]
    used[2] += count
    tried = min(matches + DOMINATORS, count)
    best_distance[:tried] = np.inf
    last = best_distance[tried - 1]
    for k in range(count):
        q = np.uint64(candidates[k])
        px, py, pz = points[q, 0], points[q, 1], points[q, 2]
        dx, dy, dz = px - cx, py - cy, pz - cz
        d2 = dx * dx + dy * dy + dz * dz
        x[k], y[k], z[k], distance[k] = px, py, pz, d2
        if d2 < last:
            t = tried - 1
            while t > 0 and best_distance[t - 1] > d2:
                best_distance[t] = best_distance[t - 1]
                best[t] = best[t - 1]
                t -= 1
            best_distance[t] = d2
            best[t] = q
            last = best_distance[tried - 1]
    record, cube = used[1], records.view(np.float32)[used[1] + CUBE :]
    cube[0], cube[1], cube[2], cube[3] = cx, cy, cz, half
    # Far above the rounding of coordinates and of the cube that a query is said to lie in.
    half *= 1.0 + 1e-6
    reach = math.sqrt(best_distance[matches - 1]) + 2.0 * math.sqrt(3.0) * half
    limit = reach * reach * (1.0 + 1e-6)
    margin = 1e-10 * limit
    left = 0
    for k in range(count):
        near = distance[k] <= limit
        x[left], y[left], z[left], distance[left] = x[k], y[k], z[k], distance[k]
        records[record + HEADER + left] = candidates[k]
        left += near
    # One dominator after the other, so that the compiler tests several candidates at a time; what
    # the first ones leave is few.
    nearer[:left] = 0
    tested = 0
    for portion in PORTIONS:
        end = min(matches + portion, tried)
        for t in range(tested, end):
            sx, sy, sz = points[best[t], 0], points[best[t], 1], points[best[t], 2]
            base = best_distance[t] + margin
            for k in range(left):
                span = abs(x[k] - sx) + abs(y[k] - sy) + abs(z[k] - sz)
                nearer[k] += np.int64(distance[k] - base > 2.0 * half * span)
        tested = end
        remaining = 0
        for k in range(left):
            kept = nearer[k] < matches
            x[remaining], y[remaining], z[remaining] = x[k], y[k], z[k]
            distance[remaining], nearer[remaining] = distance[k], nearer[k]
            records[record + HEADER + remaining] = records[record + HEADER + k]
            remaining += kept
        left = remaining
    records[record] = left
    records[record + 1] = 0
    records[record + 2] = -1
    records[record + 3] = cell
    used[1] += HEADER + left
    return record


@jit_borrowing
def _fill_coarsest(lists, cell, cx, cy, cz, half):
    tree, nearest, stack = lists.tree, lists.best_distance[: lists.matches], lists.stack
    kdtree.nearest(tree, cx, cy, cz, np.inf, lists.best, nearest, stack)
    radius = (math.sqrt(nearest[-1]) + 4.0 * half) * (1.0 + 1e-6)
    count = kdtree.within(tree, cx, cy, cz, radius, lists.matches, lists.scratch, stack)
    return _fill(lists, cell, cx, cy, cz, half, lists.scratch[:count])


@jit_borrowing
def divide(lists: Lists, record: int) -> int:
    """Give the cube of a record eight children, if there is room; returns the first of them or -1.

    The record stays readable.
    """
    cells, used, cell = lists.cells, lists.used, lists.records[record + 3]
    if cell < 0 or cells[cell] > 0 or used[0] + 8 > cells.shape[0]:
        return np.int64(-1)
    children = used[0]
    used[0] += 8
    coarsest = lists.shape[0] * lists.shape[1] * lists.shape[2]
    lists.parent[(children - coarsest) >> 3] = record
    cells[cell] = children
    return children


@jit_borrowing
def _fill_on_the_way(lists, ix, iy, iz):
    """Walk to a cube that has no list yet and fill it; returns its record.

    -1, or that of a cube around it, if there is no room left, or no budget. ix, iy, iz: the finest
    cube. Lists that are too long for the network are divided at once.
    """
    origin, shape, cells = lists.origin, lists.shape, lists.cells
    records, used = lists.records, lists.used
    last = LEVELS - 1
    side = lists.side[0] / (1 << last)
    coarsest = shape[0] * shape[1] * shape[2]
    points = lists.tree.points.shape[0]
    budget = BUDGET_POINT * points + BUDGET_QUERY * used[3]
    cell = ((iz >> last) * shape[1] + (iy >> last)) * shape[0] + (ix >> last)
    children = np.int64(-1)
    level = last
    while True:
        entry = np.int64(cells[cell])
        if entry == UNFILLED:
            width = side * (1 << level)
            cx = origin[0] + ((ix >> level) + 0.5) * width
            cy = origin[1] + ((iy >> level) + 0.5) * width
            cz = origin[2] + ((iz >> level) + 0.5) * width
            named = cell if level > 0 else np.int64(-1)
            half = 0.5 * width
            if level == last:
                room = used[1] + HEADER + points <= records.shape[0]
                if not room or used[2] > budget:
                    return np.int64(-1)
                record = _fill_coarsest(lists, named, cx, cy, cz, half)
            else:
                record = np.int64(lists.parent[(children - coarsest) >> 3])
                room = used[1] + HEADER + records[record] <= records.shape[0]
                if not room or used[2] > budget:
                    return record
                inherited = records[record + HEADER : record + HEADER + records[record]]
                record = _fill(lists, named, cx, cy, cz, half, inherited)
            entry = -1 - record
            cells[cell] = entry
        if entry < 0:
            record = -1 - entry
            if records[record] <= LONGEST:
                return record
            entry = divide(lists, record)
            if entry < 0:
                return record
        children = entry
        level -= 1
        cell = children + ((iz >> level) & 1) * 4 + ((iy >> level) & 1) * 2 + ((ix >> level) & 1)


@jit
def _spread(bits):
    """The last LEVELS - 1 = 8 bits, two zeros between neighbours."""
    bits &= 0xFF
    bits = (bits | bits << 8) & 0x00F00F
    bits = (bits | bits << 4) & 0x0C30C3
    return (bits | bits << 2) & 0x249249


@jit
def locate(lists: Lists, x: Array, y: Array, z: Array, count: int, where: Array) -> None:
    """where[i] = record of the list to search for query i; -1 if only the tree can answer.

    Queries go down level by level, many together and without a branch that depends on one of them,
    so that the processor fetches the cells of all at the same time.
    """
    origin, cells, records, shape = lists.origin, lists.cells, lists.records, lists.shape
    last = LEVELS - 1
    per_metre = (1 << last) / lists.side[0]  # finest cubes
    x0, y0, z0 = origin[0], origin[1], origin[2]
    columns, rows = shape[0], shape[1]
    x_end, y_end, z_end = shape[0] << last, shape[1] << last, shape[2] << last
    lists.used[3] += count
    finest = np.empty((TOGETHER, 3), np.int64)
    inside = np.empty(TOGETHER, np.bool_)
    turns = np.empty(TOGETHER, np.int64)  # the way down, three bits a level
    cell = np.empty(TOGETHER, np.uint64)
    for first in range(0, count, TOGETHER):
        size = min(TOGETHER, count - first)
        for j in range(size):
            # Unsigned, or numba would ask of each index whether it counts from the end.
            i = np.uint64(first + j)
            fx = (x[i] - x0) * per_metre
            fy = (y[i] - y0) * per_metre
            fz = (z[i] - z0) * per_metre
            within = (fx >= 0.0) & (fy >= 0.0) & (fz >= 0.0)
            within &= (fx < x_end) & (fy < y_end) & (fz < z_end)
            ix = np.int64(fx if within else 0.0)
            iy = np.int64(fy if within else 0.0)
            iz = np.int64(fz if within else 0.0)
            finest[j, 0], finest[j, 1], finest[j, 2] = ix, iy, iz
            inside[j] = within
            turns[j] = _spread(ix) | _spread(iy) << 1 | _spread(iz) << 2
            cell[j] = ((iz >> last) * rows + (iy >> last)) * columns + (ix >> last)
        for level in range(last - 1, -1, -1):
            deeper = False
            for j in range(size):
                entry = cells[cell[j]]
                divided = entry > 0
                child = np.uint64(entry + ((turns[j] >> (3 * level)) & 7))
                cell[j] = child if divided else cell[j]
                deeper |= divided
            if not deeper:
                break
        for j in range(size):
            record = np.int64(-1 - cells[cell[j]])
            if not inside[j]:
                record = np.int64(-1)
            elif record < 0:
                ix, iy, iz = finest[j, 0], finest[j, 1], finest[j, 2]
                record = _fill_on_the_way(lists, ix, iy, iz)
            else:
                prefetch(records, record)
            where[np.uint64(first + j)] = record


def forget(lists: Lists) -> None:
    """Empty the lists again, when little room is left for new ones."""
    coarsest = int(np.prod(lists.shape))
    lists.cells[: lists.used[0]] = UNFILLED
    lists.used[:2] = coarsest, 0


def nearly_full(lists: Lists) -> bool:
    """Whether less than a tenth of the room is left."""
    return lists.used[1] > 0.9 * len(lists.records) or lists.used[0] > 0.9 * len(lists.cells)
