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

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from icpshap.icp.intrinsics import ARRAY, INTEGER, LONG, intrinsic

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


def _network(ranks):
    """A compiled function: the `ranks` - 1 nearest candidates of LANES queries, ascending.

    nearest(coarse, records, first, count, queries, begin, largest, key). coarse: (n, 4) float32
    points; records[first : first + count]: the candidates; queries: (m, 4) float32, of which those
    from `begin` on are meant; largest: size of any coordinate, at least 1e-3; key:
    (ranks - 1, LANES) int32, flat, set to the keys. Returns the queries that are undecided and
    those that are unordered, one bit for each.
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
            differences = []
            for axis in range(3):
                coordinate = code.entry(coarse, builder.add(base, LONG(axis)))
                coordinate = code.in_all_lanes(coordinate, REALS)
                # In this order, it is read as part of the subtraction.
                differences.append(builder.fsub(query[axis], coordinate))
            x, y, z = (builder.fmul(d, d, flags=FUSED) for d in differences)
            squared = builder.fadd(builder.fadd(x, y, flags=FUSED), z, flags=FUSED)
            value = builder.and_(builder.bitcast(squared, INTEGERS), INTEGERS(~PLACE))
            place = builder.trunc(loop.index, INTEGER)
            value = builder.or_(value, code.in_all_lanes(place, INTEGERS))
            for row in smallest:
                kept = builder.load(row)
                less = builder.icmp_signed("<", value, kept)
                builder.store(builder.select(less, value, kept), row)
                value = builder.select(less, kept, value)

        keys = [builder.load(row) for row in smallest]
        bare = [builder.bitcast(builder.and_(key, INTEGERS(~PLACE)), REALS) for key in keys]
        fits = builder.fcmp_ordered("<=", largest, largest.type(LARGEST))
        absolute = builder.fmul(largest, largest.type(ABSOLUTE))
        absolute = builder.select(fits, absolute, largest.type(np.inf))
        absolute = code.in_all_lanes(builder.fptrunc(absolute, REALS.element), REALS)
        unsure = []
        for nearer, farther in itertools.pairwise(bare):
            root = code.operation(f"llvm.sqrt.v{LANES}f32", REALS, farther)
            bound = builder.fmul(farther, REALS(1.0 - RELATIVE))
            bound = builder.fsub(bound, builder.fmul(absolute, root))
            unsure.append(code.bits(builder.fcmp_unordered(">=", nearer, bound)))
        *unordered, undecided = unsure
        for rank, nearest_key in enumerate(keys[:-1]):
            builder.store(nearest_key, code.address(key, LONG(rank * LANES), INTEGERS), align=4)
        return undecided, functools.reduce(builder.or_, unordered, LONG(0))

    return nearest


nearest_one, nearest_three, nearest_five = _network(2), _network(4), _network(6)
