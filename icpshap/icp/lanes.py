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

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from icpshap.icp.intrinsics import INTEGER, LONG, align_stack, data_of, intrinsic
from icpshap.icp.minimisers import FEATURES, METRICS

if TYPE_CHECKING:
    from numba.core.typing.context import BaseContext
    from numba.core.typing.templates import Signature


LANES = 8
PRODUCTS = FEATURES * (FEATURES + 1) // 2  # entries of the upper triangle
DOUBLE = ir.DoubleType()
NUMBERS = ir.VectorType(DOUBLE, LANES)


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


def _constant(value):
    return ir.Constant(LONG, value)


def _columns(builder, rows):
    """LANES rows of four numbers as four vectors, a lane a row."""
    width = 4
    while len(rows) > 1:
        mask = ir.Constant(ir.VectorType(INTEGER, 2 * width), list(range(2 * width)))
        rows = [builder.shuffle_vector(a, b, mask) for a, b in zip(*[iter(rows)] * 2, strict=True)]
        width *= 2
    (row,) = rows
    unused = ir.Constant(row.type, ir.Undefined)
    for axis in range(4):
        column = [ir.Constant(INTEGER, 4 * lane + axis) for lane in range(LANES)]
        mask = ir.Constant(ir.VectorType(INTEGER, LANES), column)
        yield builder.shuffle_vector(row, unused, mask)


@intrinsic
def add_links(
    typing_context: BaseContext,
    metric: types.Type,
    x: types.Type,
    y: types.Type,
    z: types.Type,
    rows: types.Type,
    matches: types.Type,
    surface: types.Type,
    start: types.Type,
    count: types.Type,
    spare: types.Type,
    sums: types.Type,
    runs: types.Type,
) -> tuple[Signature, Callable]:
    """Add the kept links of up to LANES runs to their sums.

    x, y, z: (q,) queries [m], those of a run one after the other; rows: (q matches,) int32 row in
    `surface` (n, 4) of each of their links; start, count: (LANES,) int64 each lane's queries;
    spare: a query all of whose links are a row of zeros; sums: (R, PRODUCTS), the lanes' are those
    of `runs` (LANES,) int64, all different where they count any.
    """

    def generate(context, builder, signature, arguments):
        data = data_of(context, builder, signature, arguments)
        align_stack(builder, NUMBERS)

        def loaded(argument, index):
            return builder.load(builder.gep(data(argument), [index]))

        def vector(values):
            result = ir.Constant(NUMBERS, ir.Undefined)
            for lane, value in enumerate(values):
                result = builder.insert_element(result, value, ir.Constant(INTEGER, lane))
            return result

        fused = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(NUMBERS, [NUMBERS] * 3), f"llvm.fma.v{LANES}f64"
        )
        four = ir.VectorType(DOUBLE, 4)
        metric, matches, spare = arguments[0], arguments[5], arguments[9]
        starts = [loaded(7, _constant(lane)) for lane in range(LANES)]
        counts = [loaded(8, _constant(lane)) for lane in range(LANES)]
        numbers = [loaded(11, _constant(lane)) for lane in range(LANES)]
        most = counts[0]
        for lane_count in counts[1:]:
            more = builder.icmp_signed(">", lane_count, most)
            most = builder.select(more, lane_count, most)
        places = [builder.mul(number, _constant(PRODUCTS)) for number in numbers]
        totals = [cgutils.alloca_once(builder, NUMBERS) for _ in range(PRODUCTS)]
        for number, total in enumerate(totals):
            offsets = [builder.add(place, _constant(number)) for place in places]
            builder.store(vector([loaded(10, offset) for offset in offsets]), total)
        for number, features in enumerate(METRICS):
            with (
                builder.if_then(builder.icmp_signed("==", metric, _constant(number))),
                cgutils.for_range(builder, most) as queries,
            ):
                query = [
                    builder.select(
                        builder.icmp_signed("<", queries.index, lane_count),
                        builder.add(first, queries.index),
                        spare,
                    )
                    for first, lane_count in zip(starts, counts, strict=True)
                ]
                point = [
                    Lanes(builder, vector([loaded(axis, index) for index in query]))
                    for axis in (1, 2, 3)
                ]
                entries = [builder.mul(index, matches) for index in query]
                with cgutils.for_range(builder, matches) as links:
                    lines = []
                    for entry in entries:
                        row = builder.sext(loaded(4, builder.add(entry, links.index)), LONG)
                        address = builder.gep(data(6), [builder.mul(row, _constant(4))])
                        address = builder.bitcast(address, four.as_pointer())
                        lines.append(builder.load(address, align=8))
                    columns = [Lanes(builder, column) for column in _columns(builder, lines)]
                    values = [feature.value for feature in features(*point, *columns)]
                    upper = [(a, b) for place, a in enumerate(values) for b in values[place:]]
                    for (a, b), total in zip(upper, totals, strict=True):
                        builder.store(builder.call(fused, [a, b, builder.load(total)]), total)
        for number, total in enumerate(totals):
            total = builder.load(total)
            for lane, place in enumerate(places):
                address = builder.gep(data(10), [builder.add(place, _constant(number))])
                builder.store(builder.extract_element(total, ir.Constant(INTEGER, lane)), address)
        return context.get_dummy_value()

    inputs = (types.int64, x, y, z, rows, types.int64, surface, start, count, types.int64)
    return types.void(*inputs, sums, runs), generate
