"""Batches of runs: which source points each of them uses, and which runs may be matched together.

Idea: the source points are in spatial order, and are cut into blocks; a run uses some positions of
each. Runs that use nearly the same ones are a packet (`packets`), which has the positions that
any of them uses, and says which of these each of them does.
"""

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from icpshap.icp.compiled import Array, jit_borrowing
from icpshap.icp.network import LANES

BLOCK = 256  # source points that are matched together at least
SHARE = 0.5  # of its packet's points, which a run uses at least to be matched with others

Made = TypeVar("Made")


class Packets(NamedTuple):
    """Which of R runs are matched together where they are near, and at which points."""

    number: Array  # (R,) int64, ascending, equal for the runs of a packet
    joins: Array  # (R,) whether a run uses enough of its packet's points
    block_start: Array  # (blocks + 1, R) int32 into the batch's positions: those of the packet
    used: Array  # uint8: of each position of a packet, whether a run uses it
    used_start: Array  # (R,) int64: from a place in the positions to that in `used`
    spread: float  # root mean square of the points' distances from the origin of their frame [m]


class Batch(NamedTuple):
    """The source points of R runs, and where those of each block are."""

    points: Array  # (m, 3) source points in spatial order [m]
    positions: Array  # int32 ascending sets: what each run uses, one after another, or each packet
    block_start: Array  # (blocks + 1, R) int32 into positions
    packets: Packets  # their block_start is into the same positions

    def largest_block(self) -> int:
        """Queries of all runs at the block that has most, with room for whole vectors."""
        joined = np.diff(self.packets.block_start, axis=0)
        joined += -joined % LANES
        joined *= self.packets.joins
        return np.maximum(joined, np.diff(self.block_start, axis=0)).sum(axis=1).max()


@jit_borrowing
def padded(queries: int) -> int:
    """Room for a run's queries, which are computed LANES at a time."""
    return (queries + LANES - 1) // LANES * LANES


def once_each(function: Callable[[Array], Made], arrays: Sequence[Array]) -> list[Made]:
    """[function(array) for array in arrays], computed once for every distinct object among them."""
    distinct = {id(array): array for array in arrays}
    results = {key: function(array) for key, array in distinct.items()}
    return [results[id(array)] for array in arrays]


def numbered(arrays: Sequence[Array]) -> list[int]:
    """A number for each array, equal for those that are the same object."""
    number = {id(array): place for place, array in enumerate(arrays)}
    return [number[id(array)] for array in arrays]


def make_batch(points: Array, positions: Sequence[Array], number: Array) -> Batch:
    """Batch of spatially ordered points (m, 3) and R ascending int32 arrays of positions.

    number: (R,) ascending, the packet of each run.
    """
    edges = np.minimum(np.arange(0, len(points) + BLOCK, BLOCK), len(points)).astype(np.int32)
    sets: list[Array] = []
    used: list[Array] = []
    starts = once_each(lambda run: _append(run, sets) + np.searchsorted(run, edges), positions)
    block_start = np.array(starts, dtype=np.int32)
    packet_start, used_start = block_start.copy(), np.zeros(len(positions), dtype=np.int64)
    joins = np.zeros(len(positions), dtype=bool)
    ends = np.flatnonzero(np.diff(number, append=number[-1:] + 1)) + 1
    for first, last in itertools.pairwise([0, *ends]):
        if last - first > 1:
            members = slice(first, last)
            every = used_by_any(positions[members], len(points))
            packet_start[members] = _append(every, sets) + np.searchsorted(every, edges)
            # Only of runs that join: masks of others can be far larger than their positions.
            joins[members] = [len(run) >= max(SHARE * len(every), 1) for run in positions[members]]
            joining = first + np.flatnonzero(joins[members])
            masks = _masks([positions[run] for run in joining], every, len(points))
            begin = once_each(lambda mask: _append(mask, used), masks)
            used_start[joining] = np.array(begin, np.int64) - packet_start[first, 0]
    used.append(np.zeros(LANES, dtype=bool))  # behind the last of a run, a whole vector is read
    used_bytes = np.concatenate(used).view(np.uint8)
    spread = float(np.sqrt((points**2).sum(axis=1).mean()))
    # Of one block, the runs follow one another in memory.
    block_start, packet_start = (np.ascontiguousarray(s.T) for s in (block_start, packet_start))
    packets = Packets(number, joins, packet_start, used_bytes, used_start, spread)
    return Batch(points, np.concatenate(sets), block_start, packets)


def _append(part, parts):
    """Append a part; returns where it begins if they follow one another."""
    parts.append(part)
    return sum(map(len, parts[:-1]))


def used_by_any(runs: Sequence[Array], points: int) -> Array:
    """Which of that many points any of the runs uses (k,) int32, ascending."""
    marked = np.zeros(points, dtype=bool)
    for run in {id(run): run for run in runs}.values():
        marked[run] = True
    return np.flatnonzero(marked).astype(np.int32)


def _masks(positions, every, points):
    """For each run, which of the positions `every` (k,) it uses, (k,)."""
    marked = np.zeros(points, dtype=bool)

    def mask(run):
        marked[:] = False
        marked[run] = True
        return marked[every]

    return once_each(mask, positions)
