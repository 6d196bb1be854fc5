"""ICP that sees fewer points at random (paper, "Intrinsic ICP randomness")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from icpshap.causes.cause import Cause
from icpshap.options import Range

if TYPE_CHECKING:
    import numpy as np

    from icpshap.causes._given import Streams


@dataclass(frozen=True)
class IcpRandomness(Cause):
    """Of the source points that a run would use, each stays with the probability 1 / rho.

    Each raw point has one uniform number v in each run, and stays where v <= 1 / rho: nested, and
    the chain's own subsample is untouched. What is left is a subsample of probability p / rho. The
    variance of what is averaged over it is proportional to (1 - p) / p at p, so that it grows by
    the factor (rho - p) / (1 - p); without a covariance floor f is then, in 6 dimensions,
    3 (1 / factor - 1 + ln factor).
    """

    name: ClassVar = "icp_randomness"
    title: ClassVar = "ICP randomness"
    symbol: ClassVar = "ρ"
    meaning: ClassVar = "Factor rho by which the random source points of a run are fewer"
    off: ClassVar = 1.0
    range: ClassVar = Range(minimum=1, maximum=100_000)
    colour: ClassVar = "#E69F00"
    levels: ClassVar = (2.0, 5.0, 10.0)
    mitigation: ClassVar = "more points of a run (subsampling_probability)"
    scans: ClassVar = ("source",)
    order: ClassVar = 50
    counts_points: ClassVar = True
    told: ClassVar = True

    def thin(
        self, rows: np.ndarray, run: int, level: float, count: int, streams: Streams
    ) -> np.ndarray:
        luck = streams.generator(f"icp_randomness/{run}").random(count)
        return rows[luck[rows] <= 1 / level]
