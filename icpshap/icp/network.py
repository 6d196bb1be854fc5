"""Sorting network: the nearest candidates of eight queries at once, in vector registers.

Idea: eight queries share a list of candidates. For each candidate, eight squared distances are one
vector; as the bit pattern of a positive float64 orders like an integer, the lowest 8 bits can carry
the candidate's place in the list, and integer minima and maxima then keep the smallest few keys of
every query without a branch. Written in the compiler's vector instructions, because numba's own
loops would keep the keys in memory between candidates, which is three times slower; the compiler
translates them to whatever vectors the processor has.

Exactness: the distances are the same operations in the same order as everywhere else. Keys are
exact but for the 8 replaced bits; `matching` repeats the queries for which these decide.
"""

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

LANES = 8
PLACE = np.int64(255)  # the bits of a key that hold a place
LONGEST = 255  # list whose places fit
LARGEST = 2**63 - 1


def _network(rows):
    """A compiled function that writes the `rows` smallest keys of LANES queries, ascending.

    points: (n, 4); records[first : first + count]: the candidates; lanes: (3, LANES) coordinates
    of the queries, flat; key: (rows, LANES) int64, flat, the result.
    """

    @intrinsic
    def smallest_keys(typing_context, points, records, first, count, lanes, key):
        def generate(context, builder, signature, arguments):
            def data(argument):
                array = context.make_array(signature.args[argument])
                return array(context, builder, arguments[argument]).data

            integer, real = ir.IntType(64), ir.DoubleType()
            integers, reals = ir.VectorType(integer, LANES), ir.VectorType(real, LANES)

            def vector_at(pointer, row, kind):
                address = builder.gep(pointer, [ir.Constant(integer, row * LANES)])
                return builder.bitcast(address, kind.as_pointer())

            def everywhere(value, kind):
                zero = ir.Constant(ir.IntType(32), 0)
                single = builder.insert_element(ir.Constant(kind, ir.Undefined), value, zero)
                mask = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
                return builder.shuffle_vector(single, ir.Constant(kind, ir.Undefined), mask)

            def constant(value):
                return ir.Constant(integers, [ir.Constant(integer, value)] * LANES)

            query = [builder.load(vector_at(data(4), axis, reals), align=8) for axis in range(3)]
            smallest = [cgutils.alloca_once_value(builder, constant(LARGEST)) for _ in range(rows)]
            for row in smallest:
                builder.store(constant(LARGEST), row)
            with cgutils.for_range(builder, arguments[3]) as loop:
                entry = builder.gep(data(1), [builder.add(arguments[2], loop.index)])
                candidate = builder.sext(builder.load(entry), integer)
                base = builder.mul(candidate, ir.Constant(integer, 4))
                squares = []
                for axis in range(3):
                    offset = builder.add(base, ir.Constant(integer, axis))
                    coordinate = builder.load(builder.gep(data(0), [offset]))
                    difference = builder.fsub(everywhere(coordinate, reals), query[axis])
                    squares.append(builder.fmul(difference, difference))
                squared = builder.fadd(builder.fadd(squares[0], squares[1]), squares[2])
                value = builder.and_(builder.bitcast(squared, integers), constant(~int(PLACE)))
                value = builder.or_(value, everywhere(loop.index, integers))
                for row in smallest:
                    kept = builder.load(row)
                    less = builder.icmp_signed("<", value, kept)
                    builder.store(builder.select(less, value, kept), row)
                    value = builder.select(less, kept, value)
            for number, row in enumerate(smallest):
                builder.store(builder.load(row), vector_at(data(5), number, integers), align=8)
            return context.get_dummy_value()

        return types.void(points, records, types.int64, types.int64, lanes, key), generate

    return smallest_keys


two_smallest_keys, four_smallest_keys, six_smallest_keys = _network(2), _network(4), _network(6)
