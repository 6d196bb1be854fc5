"""One array of numpy's: a row for each point, or a field for each column."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from icpshap.data.formats._numpy import array_of, columns_of

if TYPE_CHECKING:
    import numpy as np


SUFFIXES = (".npy",)


def read_columns(path: Path, columns: Sequence[str] | None, wanted: Sequence[str]) -> np.ndarray:
    """The `wanted` columns (n, k) of an array of these columns; fields have names of their own.

    Without either, x, y and z are the first three. Raises DataError.
    """
    return columns_of(path, array_of(path, path.read_bytes()), columns, wanted)
