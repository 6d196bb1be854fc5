"""Candidate lists: for a cube of space, every point that can be among the k nearest of some query.

Idea (after Drost and Ilic, Machine Vision and Applications 29, 2018): cut space into cubes; a
query reads its cube's list, some forty points, and never walks a tree. A cube is filled when a
query first falls into it, from the list of the cube around it; nine sizes of cube, each half the
one above, so that crowded space is cut finer. A cube is split only while its list is long, and only
once so many candidates have been scanned in it that the split will pay, which bounds the time and
the memory of filling.

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
from icpshap.icp.compiled import jit, prefetch
from icpshap.icp.network import LONGEST

UNFILLED = -1
SIDE = 12.0  # of the coarsest cubes, in median distances to the sixth neighbour
COARSEST_CUBES = 2**22  # at most about this many; larger cubes where space is mostly empty
LEVELS = 9  # sizes of cubes, each half the one above
SHORT = 64  # a list this short is never split
WORTH_SPLITTING = 131_072  # candidates scanned in a cube before it is split
DOMINATORS = 8  # points beyond the k nearest to the centre that are tried as the nearer point
HEADER = 3  # integers before the points of a list record: length, candidates scanned, group


class Lists(NamedTuple):
    """Cubes and their lists for one reference and one number of matches."""

    origin: np.ndarray  # (3,) lower corner of the cubed box [m]
    shape: np.ndarray  # (3,) int64 number of coarsest cubes along each axis
    side: np.ndarray  # (1,) side of the coarsest cubes [m]
    cells: np.ndarray  # int32: coarsest cubes, then 8 children each; UNFILLED, first child or list
    parent: np.ndarray  # int32: list of the cube that each 8 children divide
    records: np.ndarray  # int32: the lists, HEADER and positions in tree order
    used: np.ndarray  # (2,) int64: cells and record integers in use
    scratch: np.ndarray  # (n,) int32 candidates of a coarsest cube
    scratch_distance: np.ndarray  # (n,) their squared distances to the centre


def empty_lists(tree):
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
    cells = np.full(coarsest + 8 * (8000 + 16 * n), UNFILLED, dtype=np.int32)
    return Lists(
        origin=low - margin,
        shape=shape,
        side=np.array([side]),
        cells=cells,
        parent=np.empty((len(cells) - coarsest) // 8, dtype=np.int32),
        records=np.empty(1_000_000 + 300 * n, dtype=np.int32),
        used=np.array([coarsest, 0]),
        scratch=np.empty(n, dtype=np.int32),
        scratch_distance=np.empty(n),
    )


@jit
def _fill(tree, lists, matches, cx, cy, cz, half, candidates, best, best_distance):
    """Write the list of the cube (centre, half side) out of `candidates`; returns its record."""
    points, distance = tree.points, lists.scratch_distance
    records, used = lists.records, lists.used
    count = candidates.shape[0]
    tried = min(matches + DOMINATORS, count)
    best_distance[:tried] = np.inf
    for k in range(count):
        q = candidates[k]
        dx, dy, dz = points[q, 0] - cx, points[q, 1] - cy, points[q, 2] - cz
        d2 = dx * dx + dy * dy + dz * dz
        distance[k] = d2
        if d2 < best_distance[tried - 1]:
            t = tried - 1
            while t > 0 and best_distance[t - 1] > d2:
                best_distance[t] = best_distance[t - 1]
                best[t] = best[t - 1]
                t -= 1
            best_distance[t] = d2
            best[t] = q
    # Far above the rounding of coordinates and of the cube that a query is said to lie in.
    half *= 1.0 + 1e-6
    reach = math.sqrt(best_distance[matches - 1]) + 2.0 * math.sqrt(3.0) * half
    limit = reach * reach * (1.0 + 1e-6)
    margin = 1e-10 * limit
    record = used[1]
    length = 0
    for k in range(count):
        d2 = distance[k]
        if d2 > limit:
            continue
        q = candidates[k]
        x, y, z = points[q, 0], points[q, 1], points[q, 2]
        nearer = 0
        for t in range(tried):
            s = best[t]
            span = abs(x - points[s, 0]) + abs(y - points[s, 1]) + abs(z - points[s, 2])
            if d2 - best_distance[t] > 2.0 * half * span + margin:
                nearer += 1
                if nearer == matches:
                    break
        if nearer < matches:
            records[record + HEADER + length] = q
            length += 1
    records[record] = length
    records[record + 1] = 0
    records[record + 2] = -1
    used[1] += HEADER + length
    return record


@jit
def _fill_coarsest(tree, lists, matches, cx, cy, cz, half, best, best_distance, stack):
    kdtree.nearest(tree, cx, cy, cz, matches, np.inf, best, best_distance, 0, stack)
    radius = (math.sqrt(best_distance[matches - 1]) + 4.0 * half) * (1.0 + 1e-6)
    count = kdtree.within(tree, cx, cy, cz, radius, lists.scratch, stack)
    return _fill(tree, lists, matches, cx, cy, cz, half, lists.scratch[:count], best, best_distance)


@jit
def locate(tree, lists, matches, x, y, z, count, where):
    """where[i] = record of the list to search for query i; -1 if only the tree can answer."""
    origin, cells, records, used = lists.origin, lists.cells, lists.records, lists.used
    shape = lists.shape
    last = LEVELS - 1
    side = lists.side[0] / (1 << last)  # of the finest cubes
    per_metre = 1.0 / side
    coarsest = shape[0] * shape[1] * shape[2]
    best = np.empty(matches + DOMINATORS, np.int32)
    best_distance = np.empty(matches + DOMINATORS)
    stack = np.empty(kdtree.STACK, np.int32)
    for i in range(count):
        fx = (x[i] - origin[0]) * per_metre
        fy = (y[i] - origin[1]) * per_metre
        fz = (z[i] - origin[2]) * per_metre
        inside = fx >= 0.0 and fy >= 0.0 and fz >= 0.0
        inside = inside and fx < shape[0] << last and fy < shape[1] << last
        inside = inside and fz < shape[2] << last
        if not inside:
            where[i] = -1
            continue
        ix, iy, iz = np.int64(fx), np.int64(fy), np.int64(fz)
        level = last
        shift = last
        cell = ((iz >> shift) * shape[1] + (iy >> shift)) * shape[0] + (ix >> shift)
        record = children = np.int64(-1)
        while True:
            entry = np.int64(cells[cell])
            if entry == UNFILLED:
                shift = level
                width = side * (1 << shift)
                cx = origin[0] + ((ix >> shift) + 0.5) * width
                cy = origin[1] + ((iy >> shift) + 0.5) * width
                cz = origin[2] + ((iz >> shift) + 0.5) * width
                if level == last:
                    if used[1] + HEADER + tree.points.shape[0] > records.shape[0]:
                        break
                    record = _fill_coarsest(
                        tree, lists, matches, cx, cy, cz, 0.5 * width, best, best_distance, stack
                    )
                else:
                    record = np.int64(lists.parent[(children - coarsest) >> 3])
                    if used[1] + HEADER + records[record] > records.shape[0]:
                        break
                    inherited = records[record + HEADER : record + HEADER + records[record]]
                    record = _fill(
                        tree,
                        lists,
                        matches,
                        cx,
                        cy,
                        cz,
                        0.5 * width,
                        inherited,
                        best,
                        best_distance,
                    )
                entry = -2 - 2 * record - (records[record] > SHORT)
                cells[cell] = entry
            if entry < 0:
                # An even entry is final: its record need not be read here, only sent for.
                record = (-2 - entry) >> 1
                if entry & 1 == 0 or level == 0:
                    prefetch(records, record)
                    prefetch(records, record + 16)
                    break
                length = records[record]
                records[record + 1] += length
                if records[record + 1] < WORTH_SPLITTING and length <= LONGEST:
                    break
                if used[0] + 8 > cells.shape[0]:
                    break
                entry = used[0]
                used[0] += 8
                lists.parent[(entry - coarsest) >> 3] = record
                cells[cell] = entry
            children = entry
            level -= 1
            shift = level
            child = ((iz >> shift) & 1) * 4 + ((iy >> shift) & 1) * 2 + ((ix >> shift) & 1)
            cell = children + child
        where[i] = record


def forget(lists):
    """Empty the lists again, when little room is left for new ones."""
    coarsest = int(np.prod(lists.shape))
    lists.cells[: lists.used[0]] = UNFILLED
    lists.used[:] = coarsest, 0


def nearly_full(lists):
    """Whether less than a tenth of the room is left."""
    return lists.used[1] > 0.9 * len(lists.records) or lists.used[0] > 0.9 * len(lists.cells)
