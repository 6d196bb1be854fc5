"""Sums in lanes: the Gram matrices of several runs at once, in vector registers.

Idea: a lane of a vector is a run. The next link of each run is read, its features (`minimisers`)
are computed for all lanes by the same instructions, and every entry of their Gram matrix is one
multiplication and addition of vectors. So nothing is ever summed across a vector, and a metric is
written as plain arithmetic, which is given vectors of the compiler's instead of numbers (for the
reason given in `network`).

A lane whose link is not kept, or whose run has no more queries, reads a row of zeros in the place
of a reference point. Features are linear in that row, so it adds nothing.

Exactness: each lane takes its own links one after the other, on from where its sums were. How the
links are divided into calls, which runs share a vector, or what vectors the processor has, cannot
change a bit of a sum. Products are added by fused multiplication and addition, which rounds once.

Measured: docs/engine.md.
"""

from __future__ import annotations

import itertools

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from icpshap.icp.intrinsics import ARRAY, INTEGER, LONG, Code, intrinsic
from icpshap.icp.minimisers import FEATURES, METRICS

LANES = 8
PRODUCTS = FEATURES * (FEATURES + 1) // 2  # entries of the upper triangle
NUMBERS = ir.VectorType(ir.DoubleType(), LANES)
LONGS = ir.VectorType(LONG, LANES)
ROW = ir.VectorType(ir.DoubleType(), 4)  # of `Reference.surface`


class Lanes:
    """A number for each lane; arithmetic with it writes instructions."""

    def __init__(self, builder: ir.IRBuilder, value: ir.Value) -> None:
        self.builder, self.value = builder, value

    def __add__(self, other: Lanes) -> Lanes:
        return Lanes(self.builder, self.builder.fadd(self.value, other.value))

    def __sub__(self, other: Lanes) -> Lanes:
        return Lanes(self.builder, self.builder.fsub(self.value, other.value))

    def __mul__(self, other: Lanes) -> Lanes:
        return Lanes(self.builder, self.builder.fmul(self.value, other.value))


def gram_matrices(products: np.ndarray) -> np.ndarray:
    """Gram matrices (R, FEATURES, FEATURES) from their upper triangles (R, PRODUCTS)."""
    row, column = np.triu_indices(FEATURES)
    gram = np.empty((len(products), FEATURES, FEATURES))
    gram[:, row, column] = products
    gram[:, column, row] = products
    return gram


@intrinsic(
    types.void, types.int64, *[ARRAY] * 4, types.int64, *[ARRAY] * 3, types.int64, ARRAY, ARRAY
)
def add_links(code: Code) -> None:
    """Add the kept links of up to LANES runs to their sums.

    add_links(metric, x, y, z, rows, matches, surface, start, count, spare, sums, runs). x, y, z:
    (q,) queries [m], those of a run one after the other; rows: (q matches,) int32 row in `surface`
    (n, 4) of each of their links; start, count: (LANES,) int64 each lane's queries; spare: a query
    all of whose links are a row of zeros; sums: (R, PRODUCTS), the lanes' are those of `runs`
    (LANES,) int64, all different where they count any.
    """
    builder = code.builder
    metric, x, y, z, rows, matches, surface, start, count, spare, sums, runs = code.arguments
    code.align_stack(NUMBERS)

    def of_lanes(vector):
        return [builder.extract_element(vector, INTEGER(lane)) for lane in range(LANES)]

    def to_lanes(values):
        vector = NUMBERS(ir.Undefined)
        for lane, value in enumerate(values):
            vector = builder.insert_element(vector, value, INTEGER(lane))
        return vector

    start, count, runs = (
        builder.load(code.address(array, LONG(0), LONGS), align=8) for array in (start, count, runs)
    )
    most = code.operation(f"llvm.vector.reduce.smax.v{LANES}i64", LONG, count)
    starts, counts = of_lanes(start), of_lanes(count)
    places = of_lanes(builder.mul(runs, LONGS(PRODUCTS)))
    lane_sums = [builder.gep(sums, [place]) for place in places]
    totals = []
    for number in range(PRODUCTS):
        total = to_lanes([code.entry(array, LONG(number)) for array in lane_sums])
        totals.append(cgutils.alloca_once_value(builder, total))
    for number, features in enumerate(METRICS):
        with (
            builder.if_then(builder.icmp_signed("==", metric, LONG(number))),
            cgutils.for_range(builder, most) as query,
        ):
            queries = []
            for begin, size in zip(starts, counts, strict=True):
                own = builder.icmp_signed("<", query.index, size)
                queries.append(builder.select(own, builder.add(begin, query.index), spare))
            links = [builder.mul(place, matches) for place in queries]
            point = [to_lanes([code.entry(axis, place) for place in queries]) for axis in (x, y, z)]
            with cgutils.for_range(builder, matches) as match:
                planes = []
                for first in links:
                    row = builder.sext(code.entry(rows, builder.add(first, match.index)), LONG)
                    address = code.address(surface, builder.mul(row, LONG(4)), ROW)
                    planes.append(builder.load(address, align=8))
                columns = code.columns(code.joined(planes), 4)
                values = features(*(Lanes(builder, value) for value in (*point, *columns)))
                upper = itertools.combinations_with_replacement(values, 2)
                for (a, b), total in zip(upper, totals, strict=True):
                    operands = a.value, b.value, builder.load(total)
                    added = code.operation(f"llvm.fma.v{LANES}f64", NUMBERS, *operands)
                    builder.store(added, total)
    for number, total in enumerate(totals):
        for array, value in zip(lane_sums, of_lanes(builder.load(total)), strict=True):
            builder.store(value, builder.gep(array, [LONG(number)]))
