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

from typing import NamedTuple

import numpy as np

from icpshap.icp.compiled import Array, jit, jit_borrowing
from icpshap.icp.selection import select

LEAF_SIZE = 12
STACK = 128  # more than twice the depth of any tree that fits in memory


class Tree(NamedTuple):
    """A k-d tree of n points with L leaves (a power of two); node 1 is the root."""

    # (n, 4) x, y, z [m] in tree order; the fourth column aligns rows to 32 bytes
    points: Array
    rows: Array  # (n,) int32 row of each point in the original cloud
    part: Array  # (2 L, 2) int32 first of every node's points, and the one after its last
    box: Array  # (2 L, 6) lower and upper corner of every node's points
    lowest: Array  # (2 L,) int32 lowest of every node's `rows`


@jit
def build(points: Array) -> Tree:
    """The k-d tree of points (n, 3), n >= 1."""
    n = points.shape[0]
    leaves = 1
    while leaves * LEAF_SIZE < n:
        leaves *= 2
    rows = np.arange(n).astype(np.int32)
    part = np.zeros((2 * leaves, 2), np.int32)
    box = np.empty((2 * leaves, 6))
    lowest = np.empty(2 * leaves, np.int32)
    values = np.empty((3, n))  # of a node's points along each axis
    part[1, 1] = n
    for node in range(1, 2 * leaves):
        first, end = part[node, 0], part[node, 1]
        own = rows[first:end]
        lowest[node] = own.min()
        for k in range(end - first):
            for axis in range(3):
                values[axis, k] = points[own[k], axis]
        for axis in range(3):
            low, high = np.inf, -np.inf
            for k in range(end - first):
                low, high = min(low, values[axis, k]), max(high, values[axis, k])
            box[node, axis], box[node, axis + 3] = low, high
        if node < leaves:
            middle = (first + end) >> 1
            if has_extent(box, node):
                axis = np.argmax(box[node, 3:] - box[node, :3])
                select(values[axis], end - first, middle - first, own)
            elif node == 1 or has_extent(box, node >> 1):
                in_order = own[np.argsort(own, kind="mergesort")]
                # One by one: an array written into another compiles ten times as long.
                for k in range(end - first):
                    own[k] = in_order[k]
            part[2 * node, 0], part[2 * node, 1] = first, middle
            part[2 * node + 1, 0], part[2 * node + 1, 1] = middle, end
    ordered = np.zeros((n, 4))
    for k in range(n):
        for axis in range(3):
            ordered[k, axis] = points[rows[k], axis]
    return Tree(ordered, rows, part, box, lowest)


@jit_borrowing
def has_extent(box: Array, node: int) -> bool:
    """Whether the points of a node differ; box (2 L, 6)."""
    return (
        (box[node, 0] < box[node, 3])
        | (box[node, 1] < box[node, 4])
        | (box[node, 2] < box[node, 5])
    )


@jit_borrowing
def box_distance(box: Array, node: int, x: float, y: float, z: float) -> float:
    """Squared distance from (x, y, z) to a node's box."""
    dx = max(max(box[node, 0] - x, x - box[node, 3]), 0.0)
    dy = max(max(box[node, 1] - y, y - box[node, 4]), 0.0)
    dz = max(max(box[node, 2] - z, z - box[node, 5]), 0.0)
    return dx * dx + dy * dy + dz * dz


@jit_borrowing
def _before(d2, row, distance, other, rows):
    """Whether a row at squared distance d2 comes before a point, -1 for none, at `distance`."""
    return d2 < distance or (d2 == distance and (other < 0 or row < rows[other]))


@jit_borrowing
def insert(found: Array, distance: Array, candidate: int, d2: float, rows: Array) -> None:
    """Insert a candidate into the k best, `found` and `distance` (k,), by (distance, row)."""
    row = rows[candidate]
    t = distance.shape[0] - 1
    if not _before(d2, row, distance[t], found[t], rows):
        return
    while t > 0 and _before(d2, row, distance[t - 1], found[t - 1], rows):
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
    bound: float,
    found: Array,
    distance: Array,
    stack: Array,
) -> None:
    """The k nearest points: positions in tree order, squared distances [m^2].

    distance (k,) and the first k of `found` are set. `bound` is an upper bound of the last squared
    distance (np.inf if unknown). If fewer points lie within it, the remaining entries are -1 and
    `bound`. stack: (STACK,) int32, to work with.
    """
    points, rows, part, box, lowest = tree.points, tree.rows, tree.part, tree.box, tree.lowest
    leaves = part.shape[0] >> 1
    last = distance.shape[0] - 1
    for t in range(last + 1):
        found[t] = -1
        distance[t] = bound
    stack[0] = 1
    depth = 1
    while depth > 0:
        depth -= 1
        node = np.int64(stack[depth])
        least = box_distance(box, node, x, y, z)
        if not _before(least, lowest[node], distance[last], found[last], rows):
            continue
        while node < leaves:
            node *= 2
            left = box_distance(box, node, x, y, z)
            right = box_distance(box, node + 1, x, y, z)
            if right < left or (right == left and lowest[node + 1] < lowest[node]):
                node += 1
            stack[depth] = node ^ 1  # the other child
            depth += 1
        for k in range(part[node, 0], part[node, 1]):
            dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            if d2 <= distance[last]:
                insert(found, distance, k, d2, rows)


@jit_borrowing
def within(
    tree: Tree, x: float, y: float, z: float, radius: float, most: int, found: Array, stack: Array
) -> int:
    """Positions (tree order) of the points within radius [m] to `found`; returns their number.

    Of many coincident points about the `most` with the lowest indices, which are among them.
    """
    points, part, box = tree.points, tree.part, tree.box
    leaves = part.shape[0] >> 1
    limit = radius * radius
    count = 0
    stack[0] = 1
    depth = 1
    while depth > 0:
        depth -= 1
        node = np.int64(stack[depth])
        if box_distance(box, node, x, y, z) > limit:
            continue
        first, end = part[node, 0], part[node, 1]
        if node < leaves:
            if has_extent(box, node):
                stack[depth] = 2 * node
                stack[depth + 1] = 2 * node + 1
                depth += 2
                continue
            end = min(first + most, end)  # of points at one place, in the order of their indices
        for k in range(first, end):
            dx, dy, dz = points[k, 0] - x, points[k, 1] - y, points[k, 2] - z
            if dx * dx + dy * dy + dz * dz <= limit:
                found[count] = k
                count += 1
    return count


@jit
def neighbour_distances(tree: Tree, count: int, samples: int) -> Array:
    """Distances (s,) [m] of about `samples` points to the farthest of their `count` nearest."""
    points = tree.points[:: max(1, tree.points.shape[0] // samples)]
    found, distance = np.empty(count, np.int32), np.empty(count)
    stack = np.empty(STACK, np.int32)
    result = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        nearest(tree, x, y, z, np.inf, found, distance, stack)
        result[i] = np.sqrt(distance[count - 1])
    return result
