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

import math

import numpy as np
from llvmlite import ir
from numba.core import types

from icpshap.icp.compiled import jit
from icpshap.icp.intrinsics import ARRAY, INTEGER, LONG, Code, intrinsic
from icpshap.icp.network import ABSOLUTE, PLACE, RELATIVE

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
    below = np.float32(max(length - rounding, 0.0) ** 2 * (1.0 - RELATIVE)).view(np.int32)
    beyond = np.float32((length + rounding) ** 2 * (1.0 + RELATIVE)).view(np.int32)
    return np.int32(min(below, LARGEST_KEY)), np.int32(min(beyond, NEVER - PLACE) + PLACE)


@intrinsic(types.UniTuple(types.int64, 3), ARRAY, *[types.int64] * 2, *[types.int32] * 5, ARRAY)
def decide(code: Code) -> tuple[ir.Value, ...]:
    """Rows of TOGETHER links from `first` on; what is known of those before `last`.

    decide(links, first, last, kept, dropped, made, unmade, none, rows). links: int64,
    `matching.Work.links`. Keys (int32): below `kept` a link is kept, from `dropped` on it is
    neither kept nor in the band; below `made` it is within the distance limit, from `unmade` on it
    is not. rows: int32, set to the reference point of a link that is surely kept, to `none` for
    others. Returns how many are surely kept, how many surely made, and about which it is not sure,
    a bit for each.
    """
    builder = code.builder
    links, first, last, *bounds, none, rows = code.arguments
    integers, longs = ir.VectorType(INTEGER, TOGETHER), ir.VectorType(LONG, TOGETHER)
    pairs = builder.load(code.address(links, first, longs), align=8)
    keys = builder.trunc(builder.lshr(pairs, longs(32)), integers)
    below_kept, below_dropped, below_made, below_unmade = (
        builder.icmp_signed("<", keys, code.in_all_lanes(bound, integers)) for bound in bounds
    )
    found = builder.trunc(pairs, integers)
    kept_rows = builder.select(below_kept, found, code.in_all_lanes(none, integers))
    builder.store(kept_rows, code.address(rows, first, integers), align=4)
    unsure = builder.or_(
        builder.and_(builder.not_(below_kept), below_dropped),
        builder.and_(builder.not_(below_made), below_unmade),
    )
    # Those from `last` on are another run's.
    remaining = builder.sub(last, first)
    ones = builder.sub(builder.shl(LONG(1), remaining), LONG(1))
    whole = builder.icmp_signed(">=", remaining, LONG(TOGETHER))
    own = builder.select(whole, LONG((1 << TOGETHER) - 1), ones)
    kept, made, unsure = (
        builder.and_(code.bits(mask), own) for mask in (below_kept, below_made, unsure)
    )
    return builder.ctpop(kept), builder.ctpop(made), unsure


@intrinsic(types.int64, types.int64)
def lowest(code: Code) -> ir.Value:
    """lowest(bits): place of the lowest bit that is set."""
    return code.builder.cttz(*code.arguments, ir.IntType(1)(1))
