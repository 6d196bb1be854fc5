"""Sums of products: the Gram matrix of many rows of features, in vector registers.

Idea: a link's features are one row of eight (seven and a zero), so the products of one of them
with all are one multiplication of vectors, and a Gram matrix is seven vector sums. They stay in
registers over all rows, and no sum is left to be taken across the lanes of a vector. Written in
the compiler's vector instructions for the reason given in `network`.

Exactness: each sum is taken one row after the other, on from where it was; how the rows are
divided into calls, or what vectors the processor has, cannot change a bit of it.

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

    gram: (R, FEATURES, ROW). One row after the other.
    """

    def generate(context, builder, signature, arguments):
        integer = ir.IntType(64)
        row = ir.VectorType(ir.DoubleType(), ROW)
        undefined = ir.Constant(row, ir.Undefined)

        def row_at(argument, number):
            array = context.make_array(signature.args[argument])
            data = array(context, builder, arguments[argument]).data
            address = builder.gep(data, [builder.mul(number, ir.Constant(integer, ROW))])
            return builder.bitcast(address, row.as_pointer())

        first = builder.mul(arguments[3], ir.Constant(integer, FEATURES))
        places = [
            row_at(2, builder.add(first, ir.Constant(integer, number)))
            for number in range(FEATURES)
        ]
        sums = [cgutils.alloca_once(builder, row) for _ in places]
        for place, total in zip(places, sums, strict=True):
            builder.store(builder.load(place, align=8), total)
        with cgutils.for_range(builder, arguments[1]) as loop:
            feature = builder.load(row_at(0, loop.index), align=8)
            for number, total in enumerate(sums):
                lanes = ir.Constant(ir.VectorType(ir.IntType(32), ROW), [number] * ROW)
                everywhere = builder.shuffle_vector(feature, undefined, lanes)
                product = builder.fmul(everywhere, feature)
                builder.store(builder.fadd(builder.load(total), product), total)
        for place, total in zip(places, sums, strict=True):
            builder.store(builder.load(total), place, align=8)
        return context.get_dummy_value()

    return types.void(features, types.int64, gram, types.int64), generate
