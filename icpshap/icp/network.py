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

import itertools

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from icpshap.icp.intrinsics import INTEGER, LONG, data_of, in_all_lanes, intrinsic

LANES = 16
PLACE = 255  # the bits of a key that hold a place
LONGEST = 255  # list whose places fit
RELATIVE = 2.0**-14
ABSOLUTE = 2.0**-20  # of the largest coordinate
LARGEST = 1e15  # coordinate for which the network can decide anything [m]


def _network(ranks):
    """A compiled function: the `ranks` - 1 nearest candidates of LANES queries, ascending.

    coarse: (n, 4) float32 points; records[first : first + count]: the candidates;
    queries: (m, 4) float32, of which those from `begin` on are meant; largest: size of any
    coordinate, at least 1e-3; key: (ranks - 1, LANES) int32, flat, set to the keys. Returns the
    queries that are undecided and those that are unordered, one bit for each.
    """

    @intrinsic
    def nearest(typing_context, coarse, records, first, count, queries, begin, largest, key):
        def generate(context, builder, signature, arguments):
            data = data_of(context, builder, signature, arguments)
            double, real = ir.DoubleType(), ir.FloatType()
            integers, reals = ir.VectorType(INTEGER, LANES), ir.VectorType(real, LANES)

            def vector_at(pointer, start, kind):
                return builder.bitcast(builder.gep(pointer, [start]), kind.as_pointer())

            def constant(value, kind=integers):
                return ir.Constant(kind, [ir.Constant(kind.element, value)] * LANES)

            # Rows of four to columns.
            all_rows = ir.VectorType(real, 4 * LANES)
            start = builder.mul(arguments[5], ir.Constant(LONG, 4))
            rows = builder.load(vector_at(data(4), start, all_rows), align=4)
            unused = ir.Constant(all_rows, ir.Undefined)
            query = []
            for axis in range(3):
                column = [ir.Constant(INTEGER, 4 * lane + axis) for lane in range(LANES)]
                query.append(builder.shuffle_vector(rows, unused, ir.Constant(integers, column)))

            # A key above all others, yet a finite number.
            unset = np.float32(np.finfo(np.float32).max).view(np.int32)
            smallest = [cgutils.alloca_once(builder, integers) for _ in range(ranks)]
            for row in smallest:
                builder.store(constant(int(unset)), row)
            with cgutils.for_range(builder, arguments[3]) as loop:
                entry = builder.gep(data(1), [builder.add(arguments[2], loop.index)])
                candidate = builder.sext(builder.load(entry), LONG)
                base = builder.mul(candidate, ir.Constant(LONG, 4))
                squared = None
                for axis in range(3):
                    offset = builder.add(base, ir.Constant(LONG, axis))
                    coordinate = builder.load(builder.gep(data(0), [offset]))
                    # In this order, the coordinate is read as part of the subtraction.
                    coordinate = in_all_lanes(builder, coordinate, reals)
                    difference = builder.fsub(query[axis], coordinate)
                    square = builder.fmul(difference, difference, flags=("contract",))
                    if squared is not None:
                        square = builder.fadd(squared, square, flags=("contract",))
                    squared = square
                value = builder.and_(builder.bitcast(squared, integers), constant(~PLACE))
                number = builder.trunc(loop.index, INTEGER)
                value = builder.or_(value, in_all_lanes(builder, number, integers))
                for row in smallest:
                    kept = builder.load(row)
                    less = builder.icmp_signed("<", value, kept)
                    builder.store(builder.select(less, value, kept), row)
                    value = builder.select(less, kept, value)

            root = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(reals, [reals]), f"llvm.sqrt.v{LANES}f32"
            )
            keys = [builder.load(row) for row in smallest]
            bare = [builder.bitcast(builder.and_(key, constant(~PLACE)), reals) for key in keys]
            fits = builder.fcmp_ordered("<=", arguments[6], ir.Constant(double, LARGEST))
            absolute = builder.fmul(arguments[6], ir.Constant(double, ABSOLUTE))
            absolute = builder.select(fits, absolute, ir.Constant(double, np.inf))
            absolute = in_all_lanes(builder, builder.fptrunc(absolute, real), reals)
            apart = []
            for nearer, farther in itertools.pairwise(bare):
                bound = builder.fmul(farther, constant(1.0 - RELATIVE, reals))
                bound = builder.fsub(bound, builder.fmul(absolute, builder.call(root, [farther])))
                apart.append(builder.fcmp_ordered("<", nearer, bound))
            *others, decided = apart
            ordered = constant(1, ir.VectorType(ir.IntType(1), LANES))
            for other in others:
                ordered = builder.and_(ordered, other)
            for number, nearest_key in enumerate(keys[:-1]):
                address = vector_at(data(7), ir.Constant(LONG, number * LANES), integers)
                builder.store(nearest_key, address, align=4)
            bits = [
                builder.zext(builder.bitcast(builder.not_(mask), ir.IntType(LANES)), LONG)
                for mask in (decided, ordered)
            ]
            return context.make_tuple(builder, signature.return_type, bits)

        inputs = (coarse, records, types.int64, types.int64, queries, types.int64, largest, key)
        return types.UniTuple(types.uint64, 2)(*inputs), generate

    return nearest


nearest_one, nearest_three, nearest_five = _network(2), _network(4), _network(6)
