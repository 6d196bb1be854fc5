"""What an explanation knows of a pair of scans besides its runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from icpshap.tables import PLAYED, TRANSFORM


@dataclass(frozen=True)
class ScanPair:
    """Key of the sequence, indices of the scans, and how they lie.

    characteristic_length [m]: L, the root mean square distance of the overlapping source points
    beyond the chain's minimum range from their centroid, at which a rotation counts as what it
    moves; T_reference_source (4, 4): the true pose. played: where instances are diagnosed, the
    indices of the pair that all this is of, and (-1, -1) where nothing was played.
    """

    sequence: str
    reference: int
    source: int
    characteristic_length: float
    T_reference_source: np.ndarray
    played: tuple[int, int] | None = None

    @classmethod
    def of(cls, row: Any) -> ScanPair:
        """The pair of a row (a named tuple) of a pairs table."""
        return cls(
            row.sequence,
            row.reference,
            row.source,
            row.characteristic_length,
            np.array([getattr(row, name) for name in TRANSFORM]).reshape(4, 4),
        )

    def standing_for(self, pair: tuple[int, int]) -> ScanPair:
        """The same under the indices of another pair, whose instance is played on this one."""
        reference, source = pair
        played = (self.reference, self.source)
        return replace(self, reference=reference, source=source, played=played)

    @property
    def columns(self) -> dict[str, str | int]:
        """The columns that name the pair in every table."""
        played = dict(zip(PLAYED, self.played, strict=True)) if self.played else {}
        return {
            "sequence": self.sequence,
            "reference": self.reference,
            "source": self.source,
            **played,
        }

    @property
    def to_reference_axes(self) -> np.ndarray:
        """blockdiag(R, R) (6, 6): turns pose errors from the source's axes to the reference's."""
        return np.kron(np.eye(2), self.T_reference_source[:3, :3])
