"""A balanced k-d tree: exact nearest neighbours anywhere in space.

Idea: halve the points at the median of the longest side until a leaf holds at most 12. The nodes
form a complete binary tree (children of v are 2 v and 2 v + 1), so the tree is a few flat arrays
and the points of a leaf are neighbours in memory.

Exactness: neighbours are ordered by squared distance, equal distances by the lowest index of the
original cloud. A box is left out only if its squared distance exceeds the k-th one so far. That
distance is computed by the same sequence of rounded operations as that of a point, each of them
monotone, so it never exceeds the computed distance of a point inside: no margin is needed. A box
exactly as far as the k-th one is left out, too, if all its indices are higher than that one's: none
of its points comes before it.

Coincident points, and others at equal distances, would otherwise all be read by every query near
them. As every node knows its lowest index, and of two boxes equally far the one with the lower
index is opened first, a search stops at the k lowest; so its time does not depend on how many
points are equal. Where nodes have no extent their points are in the order of their indices, and
`within` takes only the first few of each.

It finds the normals' neighbours, starts the candidate lists, and answers the few queries that the
lists do not cover. Measured at 350,000 points: 0.8 us a query of 3 neighbours, which is why the
matching does not use it alone (docs/engine.md).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from icpshap.icp import pivots
from icpshap.icp.compiled import jit, jit_borrowing

LEAF_SIZE = 12
STACK = 128  # more than twice the depth of any tree that fits in memory


class Tree(NamedTuple):
    """A k-d tree of n points with L leaves (a power of two)."""

    points: (
        np.ndarray
    )  # (n, 4) x, y, z [m] in tree order; the fourth column aligns rows to 32 bytes
    rows: np.ndarray  # (n,) int32 row of each point in the original cloud
    leaf_start: np.ndarray  # (L + 1,) int32 first point of each leaf
    box: np.ndarray  # (2 L, 6) lower and upper corner of every node's points; node 1 is the root
    lowest: np.ndarray  # (2 L,) int32 lowest of every node's `rows`


@jit
def _split_at(points, index, axis, start, stop, middle):
    """Reorder index[start:stop] so that [start, middle) lie below [middle, stop) along axis."""
    low, high = start, stop - 1
    patience = pivots.PATIENCE * (stop - start)
    number = pivots.FIRST
    while low < high:
        place = (low + high) >> 1
        patience -= high - low
        if patience < 0:
            number = pivots.drawn(number)
            place = pivots.place(number, low, high)
        pivot = points[index[place], axis]
        i, j = low, high
        while i <= j:
            while points[index[i], axis] < pivot:
                i += 1
            while points[index[j], axis] > pivot:
                j -= 1
            if i <= j:
                index[i], index[j] = index[j], index[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@jit
def build(points: np.ndarray) -> Tree:
    """The k-d tree of points (n, 3), n >= 1."""
    n = points.shape[0]
    leaves = 1
    while leaves * LEAF_SIZE < n:
        leaves *= 2
    index = np.arange(n).astype(np.int32)
    start = np.zeros(2 * leaves, np.int32)
    stop = np.zeros(2 * leaves, np.int32)
    box = np.empty((2 * leaves, 6))
    lowest = np.empty(2 * leaves, np.int32)
    stop[1] = n
    for node in range(1, 2 * leaves):
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(start[node], stop[node]):
                value = points[index[k], axis]
                low = min(low, value)
                high = max(high, value)
            box[node, axis] = low
            box[node, axis + 3] = high
        if node < leaves:
            middle = (start[node] + stop[node]) >> 1
            if not has_extent(box, node):
                if node == 1 or has_extent(box, node >> 1):
                    part = index[start[node] : stop[node]]
                    in_order = part[np.argsort(part, kind="mergesort")]
                    # One by one: an array written into another compiles ten times as long.
                    for k in range(len(in_order)):
                        part[k] = in_order[k]
            else:
                axis = np.argmax(box[node, 3:] - box[node, :3])
                _split_at(points, index, axis, start[node], stop[node], middle)
            start[2 * node], stop[2 * node] = start[node], middle
            start[2 * node + 1], stop[2 * node + 1] = middle, stop[node]
    leaf_start = np.empty(leaves + 1, np.int32)
    for leaf in range(leaves):
        leaf_start[leaf] = start[leaves + leaf]
    leaf_start[leaves] = n
    for node in range(2 * leaves - 1, 0, -1):
        if node < leaves:
            lowest[node] = min(lowest[2 * node], lowest[2 * node + 1])
        else:
            lowest[node] = index[start[node]]
            for k in range(start[node] + 1, stop[node]):
                lowest[node] = min(lowest[node], index[k])
    ordered = np.zeros((n, 4))
    for k in range(n):
        for axis in range(3):
            ordered[k, axis] = points[index[k], axis]
    return Tree(ordered, index, leaf_start, box, lowest)


@jit_borrowing
def has_extent(box: np.ndarray, node: int) -> bool:
    """Whether the points of a node differ; box (2 L, 6)."""
    return (
        (box[node, 0] < box[node, 3])
        | (box[node, 1] < box[node, 4])
        | (box[node, 2] < box[node, 5])
    )


@jit_borrowing
def box_distance(box: np.ndarray, node: int, x: float, y: float, z: float) -> float:
    """Squared distance from (x, y, z) to a node's box."""
    dx = max(max(box[node, 0] - x, x - box[node, 3]), 0.0)
    dy = max(max(box[node, 1] - y, y - box[node, 4]), 0.0)
    dz = max(max(box[node, 2] - z, z - box[node, 5]), 0.0)
    return dx * dx + dy * dy + dz * dz


@jit_borrowing
def _follows(candidate, other, index):
    return other >= 0 and index[candidate] > index[other]


@jit_borrowing
def insert(
    found: np.ndarray,
    distance: np.ndarray,
    first: int,
    count: int,
    candidate: int,
    d2: float,
    index: np.ndarray,
) -> None:
    """Insert a candidate into the `count` best from entry `first` on, by (distance, index)."""
    t = first + count - 1
    if d2 > distance[t] or (d2 == distance[t] and _follows(candidate, found[t], index)):
        return
    while t > first and (
        d2 < distance[t - 1]
        or (d2 == distance[t - 1] and not _follows(candidate, found[t - 1], index))
    ):
        distance[t] = distance[t - 1]
        found[t] = found[t - 1]
        t -= 1
    distance[t] = d2
    found[t] = candidate


@jit_borrowing
def nearest(
    tree: Tree,
    x: float,
    y: float,
    z: float,
    count: int,
    bound: float,
    found: np.ndarray,
    distance: np.ndarray,
    first: int,
    stack: np.ndarray,
) -> None:
    """The `count` nearest points: positions in tree order to `found`, squared distances [m^2].

    They are written from entry `first` on. `bound` is an upper bound of the last squared distance
    (np.inf if unknown). If fewer points lie within it, the remaining entries are -1 and `bound`.
    `stack` is an int32 work array.
    """
    points, index, box, leaf_start = tree.points, tree.rows, tree.box, tree.leaf_start
    lowest = tree.lowest
    leaves = leaf_start.shape[0] - 1
    last = first + count - 1
    for t in range(first, last + 1):
        found[t] = -1
        distance[t] = bound
    stack[0] = 1
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        least = box_distance(box, node, x, y, z)
        if least > distance[last]:
            continue
        if least == distance[last] and found[last] >= 0 and lowest[node] > index[found[last]]:
            continue
        while node < leaves:
            node *= 2
            left = box_distance(box, node, x, y, z)
            right = box_distance(box, node + 1, x, y, z)
            left_first = left < right or (left == right and lowest[node] < lowest[node + 1])
            stack[depth] = node + 1 if left_first else node
            depth += 1
            if not left_first:
                node += 1
        for k in range(leaf_start[node - leaves], leaf_start[node - leaves + 1]):
            dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            if d2 <= distance[last]:
                insert(found, distance, first, count, k, d2, index)


@jit_borrowing
def within(
    tree: Tree,
    x: float,
    y: float,
    z: float,
    radius: float,
    most: int,
    found: np.ndarray,
    stack: np.ndarray,
) -> int:
    """Positions (tree order) of the points within radius [m] to `found`; returns their number.

    Of many coincident points about the `most` with the lowest indices, which are among them.
    """
    points, box, leaf_start = tree.points, tree.box, tree.leaf_start
    leaves = leaf_start.shape[0] - 1
    limit = radius * radius
    count = 0
    stack[0] = 1
    depth = 1
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if box_distance(box, node, x, y, z) > limit:
            continue
        if node < leaves and not has_extent(box, node):
            # Its points have neighbouring places, in the order of their indices.
            last = node
            while node < leaves:
                node, last = 2 * node, 2 * last + 1
            first, end = leaf_start[node - leaves], leaf_start[last - leaves + 1]
            for k in range(first, min(first + most, end)):
                found[count] = k
                count += 1
            continue
        if node < leaves:
            stack[depth] = 2 * node
            stack[depth + 1] = 2 * node + 1
            depth += 2
            continue
        for k in range(leaf_start[node - leaves], leaf_start[node - leaves + 1]):
            dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            if dx * dx + dy * dy + dz * dz <= limit:
                found[count] = k
                count += 1
    return count


@jit
def neighbour_distances(tree: Tree, count: int, samples: int) -> np.ndarray:
    """Distances (s,) [m] of about `samples` points to the farthest of their `count` nearest."""
    n = tree.points.shape[0]
    found = np.empty(count, np.int32)
    distance = np.empty(count)
    stack = np.empty(STACK, np.int32)
    step = max(1, n // samples)
    result = np.empty((n + step - 1) // step)
    for i in range(result.shape[0]):
        x, y, z = tree.points[i * step, 0], tree.points[i * step, 1], tree.points[i * step, 2]
        nearest(tree, x, y, z, count, np.inf, found, distance, 0, stack)
        result[i] = np.sqrt(distance[count - 1])
    return result
