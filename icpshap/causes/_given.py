"""What a cause is given of what stands below it: the pair that it acts on, and random numbers."""

from collections.abc import Hashable
from typing import Protocol

import numpy as np


class RawPair(Hashable, Protocol):
    """Two raw scans and their true pose; what each is: data.pair.Pair."""

    @property
    def reference(self) -> np.ndarray: ...
    @property
    def source(self) -> np.ndarray: ...
    @property
    def T_reference_source(self) -> np.ndarray: ...
    @property
    def overlapping(self) -> np.ndarray: ...
    @property
    def overlap_distance(self) -> float: ...
    @property
    def source_times(self) -> np.ndarray | None: ...
    @property
    def minimum_range(self) -> float: ...
    @property
    def overlap(self) -> float: ...
    @property
    def overlap_in_range(self) -> np.ndarray: ...


class Streams(Protocol):
    """Random numbers by name; what each is: estimators.perturb.Streams."""

    def generator(self, name: str) -> np.random.Generator: ...
