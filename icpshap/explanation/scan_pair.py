"""What an explanation knows of a pair of scans besides its runs."""

from dataclasses import dataclass

import numpy as np

from icpshap.tables import TRANSFORM


@dataclass(frozen=True)
class ScanPair:
    """Key of the sequence, indices of the scans, and how they lie.

    characteristic_length [m]: L, the root mean square distance of the overlapping source points
    beyond the chain's minimum range from their centroid, at which a rotation counts as what it
    moves; T_reference_source (4, 4): the true pose.
    """

    sequence: str
    reference: int
    source: int
    characteristic_length: float
    T_reference_source: np.ndarray

    @classmethod
    def of(cls, row):
        """The pair of a row (a named tuple) of a pairs table."""
        return cls(
            row.sequence,
            row.reference,
            row.source,
            row.characteristic_length,
            np.array([getattr(row, name) for name in TRANSFORM]).reshape(4, 4),
        )

    @property
    def columns(self):
        """The columns that name the pair in every table."""
        return {"sequence": self.sequence, "reference": self.reference, "source": self.source}

    @property
    def to_reference_axes(self):
        """blockdiag(R, R) (6, 6): turns pose errors from the source's axes to the reference's."""
        return np.kron(np.eye(2), self.T_reference_source[:3, :3])
