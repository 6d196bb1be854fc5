"""Keys: which links are kept, read off their single-precision lengths, sixteen at a time.

Idea: the network has made a key of every link's squared length. Most links are far from the ends of
their run's band, and the key alone says on which side they are; only where it leaves that open is
the full length computed. Written in the compiler's vector instructions for the reason given in
`network`.

Exactness: let t be a squared length and K a key, without its place. By the proof in `network`, the
length of the link is within e of one whose square is between K (1 - 6 u) and K (1 + 2^-15 + 6 u),
u = 2^-24. So it is shorter than sqrt(t) if K < (sqrt(t) - e)^2 (1 - 2^-14), and not shorter if
K >= (sqrt(t) + e)^2 (1 + 2^-14), which leaves room for the rounding of full lengths and of the
bounds. As a key with its place is up to 255 units above K, the second bound is raised by as many.
Full lengths rounded to single precision are keys within the same bounds (all beyond its range have
LARGEST_KEY, of which no bound says anything; links that are not made have NEVER), so whichever way
a link was found, what is decided here is what its full length decides.

Measured: docs/engine.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from llvmlite import ir
from numba.core import types

from icpshap.icp.compiled import jit
from icpshap.icp.intrinsics import (
    INTEGER,
    LONG,
    data_of,
    in_all_lanes,
    intrinsic,
    single_bits,
)
from icpshap.icp.network import ABSOLUTE, PLACE, RELATIVE

if TYPE_CHECKING:
    from numba.core.typing.context import BaseContext
    from numba.core.typing.templates import Signature


TOGETHER = 16  # links
NEVER = np.int32(0x7F800000)  # a key above all that are found
LARGEST = float(np.finfo(np.float32).max)  # the largest key [m^2]
LARGEST_KEY = np.finfo(np.float32).max.view(np.int32)  # of all links that are at least as long


@jit
def known(bound: float, largest: float) -> tuple[int, int]:
    """Keys (below, from): links with a smaller one are shorter, with that or a larger one are not.

    bound: squared length [m^2]; largest: `candidates.Lists.largest`.
    """
    if bound == np.inf:
        return NEVER, NEVER
    rounding = ABSOLUTE / 4 * largest
    length = math.sqrt(max(bound, 0.0))
    below = single_bits(max(length - rounding, 0.0) ** 2 * (1.0 - RELATIVE))
    beyond = single_bits((length + rounding) ** 2 * (1.0 + RELATIVE))
    return np.int32(min(below, LARGEST_KEY)), np.int32(min(beyond, NEVER - PLACE) + PLACE)


@intrinsic
def decide(
    typing_context: BaseContext,
    links: types.Type,
    first: types.Type,
    last: types.Type,
    kept: types.Type,
    dropped: types.Type,
    made: types.Type,
    unmade: types.Type,
    none: types.Type,
    rows: types.Type,
) -> tuple[Signature, Callable]:
    """Rows of TOGETHER links from `first` on; what is known of those before `last`.

    links: int64, `matching.Work.links`. Keys (int32): below `kept` a link is kept, from `dropped`
    on it is neither kept nor in the band; below `made` it is within the distance limit, from
    `unmade` on it is not. rows: int32, set to the reference point of a link that is surely kept, to
    `none` for others. Returns how many are surely kept, how many surely made, and about which it
    is not sure, a bit for each.
    """

    def generate(context, builder, signature, arguments):
        data = data_of(context, builder, signature, arguments)
        integers, longs = ir.VectorType(INTEGER, TOGETHER), ir.VectorType(LONG, TOGETHER)
        bits = ir.IntType(TOGETHER)

        def pointer(argument, kind):
            return builder.bitcast(builder.gep(data(argument), [arguments[1]]), kind.as_pointer())

        def everywhere(value):
            return in_all_lanes(builder, value, integers)

        pairs = builder.load(pointer(0, longs), align=8)
        shift = ir.Constant(longs, [ir.Constant(LONG, 32)] * TOGETHER)
        keys = builder.trunc(builder.lshr(pairs, shift), integers)
        found = builder.trunc(pairs, integers)
        below_kept, below_dropped, below_made, below_unmade = (
            builder.icmp_signed("<", keys, everywhere(bound)) for bound in arguments[3:7]
        )
        address = pointer(8, integers)
        builder.store(builder.select(below_kept, found, everywhere(arguments[7])), address, align=4)
        unsure = builder.or_(
            builder.and_(builder.not_(below_kept), below_dropped),
            builder.and_(builder.not_(below_made), below_unmade),
        )
        # Those from `last` on are another run's.
        remaining = builder.sub(arguments[2], arguments[1])
        whole = builder.icmp_signed(">=", remaining, ir.Constant(LONG, TOGETHER))
        ones = builder.shl(ir.Constant(LONG, 1), remaining)
        ones = builder.sub(ones, ir.Constant(LONG, 1))
        ones = builder.select(whole, ir.Constant(LONG, (1 << TOGETHER) - 1), ones)
        known_kept, known_made, unsure = (
            builder.and_(builder.zext(builder.bitcast(mask, bits), LONG), ones)
            for mask in (below_kept, below_made, unsure)
        )
        results = [builder.ctpop(known_kept), builder.ctpop(known_made), unsure]
        return context.make_tuple(builder, signature.return_type, results)

    inputs = (links, types.int64, types.int64, *[types.int32] * 5, rows)
    return types.UniTuple(types.int64, 3)(*inputs), generate


@intrinsic
def lowest(typing_context: BaseContext, bits: types.Type) -> tuple[Signature, Callable]:
    """Place of the lowest bit that is set."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate
