"""The ICP chain, assembled from named parts (Pomerleau et al., Autonomous Robots 34, 2013)."""

from dataclasses import dataclass, field

import numpy as np

from icpshap.icp.minimisers import PointToPlane, PointToPoint


@dataclass(frozen=True)
class Trimmed:
    """Keep the links that are not longer than a quantile of all of a run's links.

    With n links, those with d^2 <= v[int(n * ratio)], v the sorted squared lengths, are kept;
    ratio 1 keeps all.
    """

    ratio: float = 0.7

    def __post_init__(self) -> None:
        if not 0 < self.ratio <= 1:
            raise ValueError(f"Trimmed: ratio must be in (0, 1], not {self.ratio}.")

    def rank(self, links: np.ndarray) -> np.ndarray:
        """Position of the longest kept link among that many (R,), sorted; `links` keeps all."""
        return (links * self.ratio).astype(np.int64)


@dataclass(frozen=True)
class Stopping:
    """Stop once the mean of the last three steps is below both limits [rad, m], or at the maximum.

    A step's rotation is its angle; its translation is measured at the reference's centre.
    """

    maximum_iterations: int = 150
    rotation: float = 1e-3
    translation: float = 1e-2

    def __post_init__(self) -> None:
        if self.maximum_iterations < 1:
            raise ValueError(
                f"Stopping: maximum_iterations must be at least 1, not {self.maximum_iterations}."
            )


@dataclass(frozen=True)
class Chain:
    """What `register` does with a pair of clouds.

    matches: links per source point, to its nearest reference points, 1 to 5.
    maximum_distance: links longer than this [m] are not made; None for no limit.
    """

    error_minimiser: PointToPlane | PointToPoint = field(default_factory=PointToPlane)
    matches: int = 3
    outlier_filter: Trimmed = field(default_factory=Trimmed)
    maximum_distance: float | None = None
    stopping: Stopping = field(default_factory=Stopping)

    def __post_init__(self) -> None:
        if self.matches not in (1, 2, 3, 4, 5):
            raise ValueError(f"Chain: matches must be 1, 2, 3, 4 or 5, not {self.matches}.")
        if self.maximum_distance is not None and not self.maximum_distance > 0:
            raise ValueError(
                f"Chain: maximum_distance must be positive or None, not {self.maximum_distance}."
            )
