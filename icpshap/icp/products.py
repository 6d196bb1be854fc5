"""Sums of products: the Gram matrix of many rows of features, in vector registers.

Idea: a link's features are one row of eight (seven and a zero), so the products of one of them
with all are one multiplication of vectors, and a Gram matrix is seven vector sums. They stay in
registers over all rows, and no sum is left to be taken across the lanes of a vector. Written in
the compiler's vector instructions for the reason given in `network`.

Exactness: each sum is taken in the order of the rows, whatever the processor's vectors are.

Measured: docs/engine.md.
"""

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

FEATURES = 7
ROW = 8  # entries of a row of features, and of a row of a Gram matrix


@intrinsic
def add_products(typing_context, features, count, gram, run):
    """Add the products of the first `count` rows of `features` (n, ROW) to gram[run].

    gram: (R, FEATURES, ROW).
    """

    def generate(context, builder, signature, arguments):
        integer = ir.IntType(64)
        row = ir.VectorType(ir.DoubleType(), ROW)
        undefined, zero = ir.Constant(row, ir.Undefined), ir.Constant(row, [0.0] * ROW)

        def row_at(argument, number):
            array = context.make_array(signature.args[argument])
            data = array(context, builder, arguments[argument]).data
            address = builder.gep(data, [builder.mul(number, ir.Constant(integer, ROW))])
            return builder.bitcast(address, row.as_pointer())

        sums = [cgutils.alloca_once(builder, row) for _ in range(FEATURES)]
        for total in sums:
            builder.store(zero, total)
        with cgutils.for_range(builder, arguments[1]) as loop:
            feature = builder.load(row_at(0, loop.index), align=8)
            for number, total in enumerate(sums):
                lanes = ir.Constant(ir.VectorType(ir.IntType(32), ROW), [number] * ROW)
                everywhere = builder.shuffle_vector(feature, undefined, lanes)
                product = builder.fmul(everywhere, feature)
                builder.store(builder.fadd(builder.load(total), product), total)
        first = builder.mul(arguments[3], ir.Constant(integer, FEATURES))
        for number, total in enumerate(sums):
            place = row_at(2, builder.add(first, ir.Constant(integer, number)))
            before = builder.load(place, align=8)
            builder.store(builder.fadd(before, builder.load(total)), place, align=8)
        return context.get_dummy_value()

    return types.void(features, types.int64, gram, types.int64), generate
