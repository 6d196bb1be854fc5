"""What a format of `icpshap export` is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from icpshap.errors import UserError
from icpshap.export.measurement import Measurement

if TYPE_CHECKING:
    import numpy as np


class Format(ABC):
    """How measurements are written; `name`: what `--to` gives; `meaning`: what it is, in words.

    all_coalitions: whether it wants the measurements of every coalition of the instance's causes,
    and not only of the one with all on.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    all_coalitions: ClassVar[bool] = False

    @abstractmethod
    def texts(self, measurements: list[Measurement]) -> dict[str, str]:
        """The content of each file, by what its name has before the suffix ("" of the first)."""


def numbers(values: np.ndarray) -> str:
    """Numbers (n,) as words that give the same numbers when they are read."""
    return " ".join(repr(float(value)) for value in values)


def of_one_sequence(measurements: Sequence[Measurement], name: str) -> None:
    """Raise UserError unless all are of one sequence: indices of scans mean nothing across them."""
    known = sorted({measurement.sequence for measurement in measurements})
    if len(known) > 1:
        raise UserError(
            f"{name}: measurements of the sequences {', '.join(known)}, expected one.\n"
            f"Hint: --sequence {known[0]}"
        )
