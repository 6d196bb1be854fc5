"""Sorting network: the nearest candidates of sixteen queries at once, in vector registers.

Idea: sixteen queries share a list of candidates. For each candidate, sixteen squared distances in
single precision are one vector; as the bit pattern of a positive float orders like an integer, the
lowest 8 bits can carry the candidate's place in the list, and integer minima and maxima then keep
the smallest few keys of every query without a branch. Written in the compiler's vector
instructions, because numba's own loops would keep the keys in memory between candidates, which is
three times slower; the compiler translates them to whatever vectors the processor has.

Exactness: keys are approximate, so the network also proves which queries they decide. Let all
coordinates be at most M in size and u = 2^-24. Rounding moves a point and a query by at most
sqrt(3) u M each, their distance by at most e = 2 sqrt(3) u M; computing the squared distance
changes it by less than 6 u of itself, clearing 8 bits by less than 2^-15 of itself. So for keys
a < b, without their places, the point of a is surely nearer than every point with a key of b or
more if sqrt(a) (1 + 2^-16 + 3 u) + e < sqrt(b) (1 - 3 u) - e, and for that it is enough that
a < b - (2^-15 + 12 u) b - 4 e sqrt(b). The test takes 2^-14 for the first factor and 2^-20 M for
4 e, which leaves room for its own rounding. M >= 1e-3 keeps what it accepts far from underflow,
M <= 1e15 from overflow. A query that fails the test between the last two of its k + 1 smallest keys
is reported as undecided, and `matching` repeats it with full distances; one that fails it between
two others, as unordered: the k nearest are found, and full distances of these few order them.

Measured: docs/engine.md.
"""

import functools
import itertools
from collections.abc import Iterable, Iterator

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from icpshap.icp.intrinsics import ARRAY, INTEGER, LONG, Code, intrinsic

LANES = 16
PLACE = 255  # the bits of a key that hold a place
LONGEST = 255  # list whose places fit
RELATIVE = 2.0**-14
ABSOLUTE = 2.0**-20  # of the largest coordinate
LARGEST = 1e15  # coordinate for which the network can decide anything [m]
INTEGERS = ir.VectorType(INTEGER, LANES)
REALS = ir.VectorType(ir.FloatType(), LANES)
ROWS = ir.VectorType(ir.FloatType(), 4 * LANES)
FUSED = ("contract",)  # a product and the sum that it enters may round once


def squared_distance(
    builder: ir.IRBuilder, one: Iterable[ir.Value], other: Iterable[ir.Value]
) -> ir.Value:
    """Of the points in each lane, x, y and z of REALS."""
    differences = [builder.fsub(a, b) for a, b in zip(one, other, strict=True)]
    x, y, z = (builder.fmul(d, d, flags=FUSED) for d in differences)
    return builder.fadd(builder.fadd(x, y, flags=FUSED), z, flags=FUSED)


def rounding(code: Code, largest: ir.Value) -> ir.Value:
    """4 e in all lanes, for coordinates up to `largest`; infinite where keys decide nothing."""
    fits = code.builder.fcmp_ordered("<=", largest, largest.type(LARGEST))
    absolute = code.builder.fmul(largest, largest.type(ABSOLUTE))
    absolute = code.builder.select(fits, absolute, largest.type(np.inf))
    return code.in_all_lanes(code.builder.fptrunc(absolute, REALS.element), REALS)


def length(code: Code, squared: ir.Value) -> ir.Value:
    """The square root in each lane."""
    return code.operation(f"llvm.sqrt.v{LANES}f32", REALS, squared)


def without_place(builder: ir.IRBuilder, key: ir.Value) -> ir.Value:
    """The squared length of keys."""
    return builder.bitcast(builder.and_(key, INTEGERS(~PLACE)), REALS)


def not_surely_ascending(
    code: Code, keys: Iterable[ir.Value], absolute: ir.Value
) -> Iterator[ir.Value]:
    """Of each two neighbouring keys, whether the farther point may be as near."""
    bare = [without_place(code.builder, key) for key in keys]
    for nearer, farther in itertools.pairwise(bare):
        bound = code.builder.fmul(farther, REALS(1.0 - RELATIVE))
        moved = code.builder.fmul(absolute, length(code, farther))
        yield code.builder.fcmp_unordered(">=", nearer, code.builder.fsub(bound, moved))


def _network(ranks):
    """A compiled function: the keys of LANES queries' `ranks` nearest candidates, ascending.

    nearest(coarse, records, first, count, queries, begin, largest, key). coarse: (n, 4) float32
    points; records[first : first + count]: the candidates; queries: (m, 4) float32, of which those
    from `begin` on are meant; largest: size of any coordinate, at least 1e-3; key: (ranks, LANES)
    int32, flat, set to the keys. Returns the queries of which the `ranks` - 1 nearest are undecided
    and those of which they are unordered, one bit for each.
    """

    @intrinsic(
        *(types.UniTuple(types.uint64, 2), ARRAY, ARRAY, types.int64, types.int64),
        *(ARRAY, types.int64, types.float64, ARRAY),
    )
    def nearest(code):
        builder = code.builder
        coarse, records, first, count, queries, begin, largest, key = code.arguments
        address = code.address(queries, builder.mul(begin, LONG(4)), ROWS)
        query = list(code.columns(builder.load(address, align=4), 3))
        # A key above all others, yet a finite number.
        unset = INTEGERS(int(np.float32(np.finfo(np.float32).max).view(np.int32)))
        smallest = [cgutils.alloca_once_value(builder, unset) for _ in range(ranks)]
        with cgutils.for_range(builder, count) as loop:
            candidate = builder.sext(code.entry(records, builder.add(first, loop.index)), LONG)
            base = builder.mul(candidate, LONG(4))
            # One by one, as they are asked for: so each is read as part of its subtraction.
            point = (
                code.in_all_lanes(code.entry(coarse, builder.add(base, LONG(axis))), REALS)
                for axis in range(3)
            )
            value = builder.bitcast(squared_distance(builder, query, point), INTEGERS)
            place = code.in_all_lanes(builder.trunc(loop.index, INTEGER), INTEGERS)
            value = builder.or_(builder.and_(value, INTEGERS(~PLACE)), place)
            for row in smallest:
                kept = builder.load(row)
                less = builder.icmp_signed("<", value, kept)
                builder.store(builder.select(less, value, kept), row)
                value = builder.select(less, kept, value)

        keys = [builder.load(row) for row in smallest]
        unsure = map(code.bits, not_surely_ascending(code, keys, rounding(code, largest)))
        *unordered, undecided = unsure
        for rank, nearest_key in enumerate(keys):
            builder.store(nearest_key, code.address(key, LONG(rank * LANES), INTEGERS), align=4)
        return undecided, functools.reduce(builder.or_, unordered, LONG(0))

    return nearest


nearest_one, nearest_three, nearest_five = _network(2), _network(4), _network(6)
