"""Packets: runs of nearly the same source points, which are near one another, are matched at once.

Idea: runs that differ by their initial pose, or by points that were removed, are a packet. As they
converge, a source point is at nearly the same place in all of them. So of the runs that are near
one another one leads: only its points are located, sorted and sent through the network, which finds
the five nearest of the cube's list. The others choose among these five, sixteen points at a time.
No list is found or read for them.

Exactness: let d be the distance from the lead's query to the sixth nearest of the list, and m that
from it to another run's query in the same cube. Every point of the list but the five is at least
d - m away from the latter, and no point outside the list is among its k nearest. So if the k-th
nearest of the five is nearer than d - m, the k nearest are among them. This is tested in single
precision with the bounds of `network`, for lengths instead of their squares: a length is known to
e and 2^-16 + 3 u of itself, and three of them are compared. A query that fails is matched like any
other; one that passes, but whose order is not sure, has the full distances of the five computed.
Points of the packet that a run does not use have no links. So no byte of a run depends on which
others are in its packet.

Runs of one or of three matches a point choose; with another number, as no preset has it, each is
matched alone.

Measured: docs/engine.md.
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from icpshap.icp.batches import Batch, Packets
from icpshap.icp.candidates import CUBE, HEADER, Lists, locate
from icpshap.icp.compiled import Array, jit, jit_borrowing
from icpshap.icp.intrinsics import ARRAY, INTEGER, LONG, intrinsic
from icpshap.icp.keys import NEVER, lowest
from icpshap.icp.matching import Work, match, move, scan, sort_by_list, visit, work_arrays
from icpshap.icp.network import (
    INTEGERS,
    LANES,
    LARGEST,
    LONGEST,
    PLACE,
    REALS,
    RELATIVE,
    length,
    nearest_five,
    not_surely_ascending,
    rounding,
    squared_distance,
    without_place,
)

CANDIDATES = 5
MATCHES = (1, 3)  # of each query, of runs that are matched together
NEAR = 0.02  # sides of a coarsest cube: how far from its lead a run may be
LEAST = 3  # runs of a cluster; fewer take less time alone
DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
BYTES = ir.VectorType(ir.IntType(8), LANES)
LONGS = ir.VectorType(LONG, LANES)
ROW = ir.VectorType(ir.FloatType(), 4)
FOURS = ir.VectorType(INTEGER, 4 * LANES)


class Together(NamedTuple):
    """Arrays for runs that are matched together."""

    work: Work  # for the leads' queries, and for those that could not choose
    # (2, n + LANES, 4) int32: the points next to each lead's query, five of CANDIDATES, the record
    # of its list, and the sixth key, 0 where there is none
    near: Array
    unsure: Array  # (2 R,) int64: for each run of LANES queries, the unproven and the unordered
    failed: Array  # (n,) int64 queries that could not choose
    source: Array  # (3, LANES) points
    few: Array  # (CANDIDATES,) int32 points


def together(queries: int, runs: int, matches: int) -> Together:
    """Room for that many queries, of that many runs."""
    near = np.zeros((2, queries + LANES, 4), dtype=np.int32)
    unsure, failed = np.empty(2 * runs, dtype=np.int64), np.empty(queries, dtype=np.int64)
    source, few = np.zeros((3, LANES)), np.zeros(CANDIDATES, dtype=np.int32)
    return Together(work_arrays(queries, matches), near, unsure, failed, source, few)


def _rows_at(code, array, places):
    """Columns of rows of four single-precision numbers; each lane's row begins at its place."""
    rows = []
    for lane in range(LANES):
        place = code.builder.extract_element(places, INTEGER(lane))
        rows.append(code.builder.load(code.address(array, place, ROW), align=4))
    return list(code.columns(code.joined(rows), 4))


def _moved(code, points, T, run):
    """Points (x, y, z), moved by T[run]: by the operations of `matching.move`, in their order."""
    builder = code.builder
    for axis in range(3):
        places = (LONG(4 * axis + column) for column in range(4))
        entries = [code.entry(T, builder.add(builder.mul(run, LONG(16)), at)) for at in places]
        *factors, shift = (code.in_all_lanes(entry, DOUBLES) for entry in entries)
        terms = [builder.fmul(a, b) for a, b in zip(factors, points, strict=True)]
        yield functools.reduce(builder.fadd, [*terms, shift])


def _nearest(builder, query, candidates, ranks):
    """Keys of the nearest candidates, ascending; their places are numbers among the candidates."""
    smallest: list[ir.Value] = []
    for number, candidate in enumerate(candidates):
        key = builder.bitcast(squared_distance(builder, query, candidate), INTEGERS)
        key = builder.or_(builder.and_(key, INTEGERS(~PLACE)), INTEGERS(number))
        ranked = []
        for kept in smallest:
            less = builder.icmp_signed("<", key, kept)
            ranked.append(builder.select(less, key, kept))
            key = builder.select(less, kept, key)
        smallest = [*ranked, key][:ranks]
    return smallest


def _links(code, keys, numbers, own):
    """`Work.links` of the lanes, those of a query one after the other; of none that is not own."""
    builder, parts = code.builder, []
    for key in keys:
        found, which = numbers[0], builder.and_(key, INTEGERS(PLACE))
        for number in range(1, CANDIDATES):
            same = builder.icmp_signed("==", which, INTEGERS(number))
            found = builder.select(same, numbers[number], found)
        found = builder.zext(builder.select(own, found, INTEGERS(-1)), LONGS)
        key = builder.zext(builder.select(own, key, INTEGERS(int(NEVER))), LONGS)
        parts.append(builder.or_(builder.shl(key, LONGS(32)), found))
    places = [t * LANES + lane for lane in range(LANES) for t in range(len(keys))]
    every = code.joined([*parts, parts[-1]])
    return builder.shuffle_vector(every, every, ir.VectorType(INTEGER, len(places))(places))


def _choose(matches: int) -> Callable:
    """A compiled function: LANES queries of each run of a cluster, and their links.

    choose(near, room, lead, lead_x, lead_y, lead_z, coarse, records, source, T, order, first, last,
    begin, offset, used, used_start, position, largest, x, y, z, links, unsure). near, room:
    `Together.near` and its second length; lead: the lead's first query, of all in `lead_x`,
    `lead_y`, `lead_z`; coarse, records: of `Lists`; source: (3, LANES) points, at `position` in the
    batch; order[first:last]: the runs; their queries are `offset` behind `begin` (R,); used,
    used_start: of `Packets`; x, y, z, links: of `Work`, set; unsure: of `Together`, set.
    """

    @intrinsic(
        types.void,
        *(ARRAY, types.int64, types.int64, *[ARRAY] * 8, types.int64, types.int64),
        *(ARRAY, types.int64, ARRAY, ARRAY, types.int64, types.float64, *[ARRAY] * 5),
    )
    def choose(code):
        builder = code.builder
        near, room, lead, *rest = code.arguments
        lead_x, lead_y, lead_z, coarse, records, source, T, order, first, last, *rest = rest
        begin, offset, used, used_start, position, largest, x, y, z, links, unsure = rest
        code.align_stack(REALS)
        known = []
        for number in range(2):
            row = builder.add(lead, builder.mul(room, LONG(number)))
            address = code.address(near, builder.mul(row, LONG(4)), FOURS)
            known += code.columns(builder.load(address, align=4), 4)
        *numbers, record, sixth, _ = known
        candidates = [
            _rows_at(code, coarse, builder.mul(builder.zext(row, LONGS), LONGS(4)))[:3]
            for row in numbers
        ]
        cube = builder.add(builder.zext(record, LONGS), LONGS(CUBE))
        *centre, half = _rows_at(code, records, cube)
        origin = [
            builder.fptrunc(builder.load(code.address(axis, lead, DOUBLES), align=8), REALS)
            for axis in (lead_x, lead_y, lead_z)
        ]
        absolute = rounding(code, largest)
        sixth = length(code, without_place(builder, sixth))
        bound = builder.fsub(builder.fmul(sixth, REALS(1.0 - RELATIVE)), absolute)
        reach = builder.fsub(half, absolute)
        points = [
            builder.load(code.address(source, LONG(axis * LANES), DOUBLES), align=8)
            for axis in range(3)
        ]
        with cgutils.for_range(builder, builder.sub(last, first)) as loop:
            run = code.entry(order, builder.add(first, loop.index))
            place, query = builder.add(code.entry(begin, run), offset), []
            for axis, value in zip((x, y, z), _moved(code, points, T, run), strict=True):
                builder.store(value, code.address(axis, place, DOUBLES), align=8)
                query.append(builder.fptrunc(value, REALS))
            keys = _nearest(builder, query, candidates, matches + 1)
            farthest = length(code, without_place(builder, keys[matches - 1]))
            apart = length(code, squared_distance(builder, query, origin))
            unproven = builder.fcmp_unordered(">=", builder.fadd(farthest, apart), bound)
            for a, b in zip(query, centre, strict=True):
                away = code.operation(f"llvm.fabs.v{LANES}f32", REALS, builder.fsub(a, b))
                unproven = builder.or_(unproven, builder.fcmp_unordered(">", away, reach))
            unordered = functools.reduce(builder.or_, not_surely_ascending(code, keys, absolute))
            place_used = builder.add(code.entry(used_start, run), position)
            own = builder.load(code.address(used, place_used, BYTES), align=1)
            own = builder.icmp_unsigned("!=", own, BYTES(0))
            found = _links(code, keys[:matches], numbers, own)
            address = code.address(links, builder.mul(place, LONG(matches)), found.type)
            builder.store(found, address, align=8)
            entry = builder.mul(loop.index, LONG(2))
            for number, which in enumerate((unproven, unordered)):
                bits = code.bits(builder.and_(which, own))
                builder.store(bits, builder.gep(unsure, [builder.add(entry, LONG(number))]))

    return choose


_choose_one, _choose_three = map(_choose, MATCHES)


def clusters(active: Array, packets: Packets, T: Array, reach: float) -> tuple[Array, Array]:
    """The active runs in another order: first those to match alone, then clusters with a lead each.

    T: (R, 4, 4); reach [m]: how far from its lead, about, a run may be. Returns the order and where
    in it the runs to match alone, and each cluster, end. The first run of a cluster is its lead.
    """
    lead = _leads(active, packets, T, reach)
    size = np.bincount(lead, minlength=len(active))
    alone = size[lead] < LEAST
    order = np.argsort(np.where(alone, -1, lead), kind="stable")
    return active[order], np.cumsum([np.count_nonzero(alone), *size[size >= LEAST]])


@jit
def _leads(active, packets, T, reach):
    """The place of each active run's lead among them, which is its own if it follows no other."""
    lead = np.arange(len(active))
    number, joins, spread = packets.number, packets.joins, packets.spread
    first = 0
    for k in range(len(active)):
        run = active[k]
        if number[run] != number[active[first]]:
            first = k
        nearest = reach * reach
        for place in range(first, k if joins[run] else first):
            other = active[place]
            if lead[place] == place and joins[other]:
                away = 0.0
                for i in range(3):
                    for j in range(3):
                        away += (spread * (T[run, i, j] - T[other, i, j])) ** 2
                    away += (T[run, i, 3] - T[other, i, 3]) ** 2
                if away < nearest:
                    nearest, lead[k] = away, place
    return lead


@jit
def _match_leads(lists, count, together):
    """What the other runs choose from, for the first `count` queries."""
    work, near, records, coarse = together.work, together.near, lists.records, lists.coarse
    ordered, group_end, nearest, largest = work.ordered, work.group_end, work.nearest, lists.largest
    number = ordered.view(np.int32)
    locate(lists, work.x, work.y, work.z, count, work.where)
    near[:, :count] = 0  # a point, the first record, and a key that proves nothing
    groups = sort_by_list(records, count, work)
    begin = 0
    for group in range(groups):
        end = group_end[group]
        record, length = visit(lists, work, group, groups, end - begin)
        first = record + HEADER
        # Beyond LARGEST, the network may have found fewer than there are.
        if not CANDIDATES < length <= LONGEST or largest > LARGEST:
            begin = end
        while begin < end:
            nearest_five(coarse, records, first, length, ordered, begin, largest, nearest)
            for lane in range(min(LANES, end - begin)):
                query = np.uint64(number[np.uint64(begin + lane), 3])
                for t in range(CANDIDATES):
                    key = nearest[np.uint64(t * LANES + lane)]
                    entry = np.uint64(first) + np.uint64(key & PLACE)
                    near[np.uint64(t >> 2), query, np.uint64(t & 3)] = records[entry]
                near[np.uint64(1), query, np.uint64(1)] = record
                near[np.uint64(1), query, np.uint64(2)] = nearest[CANDIDATES * LANES + lane]
            begin += LANES
        begin = end


@jit_borrowing
def _choose_all(batch, T, order, ends, first, last, begin, lists, work, together):
    """Queries and links of the clusters' runs; returns how many queries could not choose.

    Those are in `together.failed`.
    """
    points, positions, packets, leads = batch.points, batch.positions, batch.packets, together.work
    near, source, unsure, failed = together.near, together.source, together.unsure, together.failed
    lead = failures = np.int64(0)
    for cluster in range(1, len(ends)):
        start, stop = ends[cluster - 1], ends[cluster]
        position = packets.block_start[first, order[start]]
        number = packets.block_start[last, order[start]] - position
        for offset in range(0, number, LANES):
            lanes = min(LANES, number - offset)
            for lane in range(lanes):
                p = np.uint64(positions[np.uint64(position + offset + lane)])
                for axis in range(3):
                    source[axis, np.uint64(lane)] = points[p, axis]
            choice = (
                *(near, near.shape[1], lead, leads.x, leads.y, leads.z, lists.coarse),
                *(lists.records, source, T, order, start, stop, begin, offset, packets.used),
                *(packets.used_start, position + offset, lists.largest),
                *(work.x, work.y, work.z, work.links, unsure),
            )
            if lists.matches == 1:
                _choose_one(*choice)
            else:
                _choose_three(*choice)
            own = (1 << lanes) - 1
            for k in range(stop - start):
                query = begin[order[start + k]] + offset
                unproven, unordered = unsure[2 * k] & own, unsure[2 * k + 1] & own
                unordered &= ~unproven
                while unproven:
                    failed[failures] = query + lowest(unproven)
                    failures += 1
                    unproven &= unproven - 1
                while unordered:
                    lane = lowest(unordered)
                    unordered &= unordered - 1
                    for c in range(CANDIDATES):
                        together.few[c] = near[c >> 2, lead + lane, c & 3]
                    scan(lists, work, np.uint64(query + lane), together.few)
            lead += lanes
    return failures


@jit
def match_clusters(
    lists: Lists,
    limit: float,
    batch: Batch,
    T: Array,
    order: Array,
    ends: Array,
    first: int,
    last: int,
    begin: Array,
    work: Work,
    together: Together,
) -> None:
    """Queries and links of the runs of `clusters`, at the source points of some blocks.

    first, last: the blocks; begin: (R,) place of each run's first query.
    """
    side, packets, count = together.work, batch.packets, np.int64(0)
    for cluster in range(1, len(ends)):
        run = order[ends[cluster - 1]]
        own = batch.positions[packets.block_start[first, run] : packets.block_start[last, run]]
        count += move(batch.points, own, T, run, side.x, side.y, side.z, count)
    _match_leads(lists, count, together)
    count = _choose_all(batch, T, order, ends, first, last, begin, lists, work, together)
    failed = together.failed
    for k in range(count):
        side.x[k], side.y[k], side.z[k] = work.x[failed[k]], work.y[failed[k]], work.z[failed[k]]
    match(lists, limit, count, side)
    for k in range(count):
        for t in range(lists.matches):
            work.links[failed[k] * lists.matches + t] = side.links[k * lists.matches + t]
