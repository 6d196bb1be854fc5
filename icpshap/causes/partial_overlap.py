"""Too little overlap between the scans (paper, "Partial Overlap")."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap import se3
from icpshap.causes.cause import Cause
from icpshap.errors import PerturbationError
from icpshap.geometry import nearest_distances
from icpshap.options import Range, option

if TYPE_CHECKING:
    from icpshap.causes._given import RawPair, Streams


CLOSE_ENOUGH = 1e-3  # of the overlap ratio, within which the released code changes nothing
JITTER = 0.001  # m, of the reference points that the released code copies


@dataclass(frozen=True)
class PartialOverlap(Cause):
    """round(lambda |P1|) overlapping points of the raw source are removed, and no others.

    scattered: drawn at random. sector: by rising azimuth about the source's z axis, from an azimuth
    that is drawn for each noise draw, as when something stands before the scanner.
    """

    name: ClassVar = "partial_overlap"
    title: ClassVar = "partial overlap"
    symbol: ClassVar = "λ"
    unit: ClassVar = ""
    meaning: ClassVar = "Share lambda of |P1| by which the overlap is reduced"
    range: ClassVar = Range(minimum=0, maximum=1)
    colour: ClassVar = "#009E73"
    levels: ClassVar = (0.02, 0.05, 0.1)
    mitigation: ClassVar = "scans that are nearer to each other"
    scans: ClassVar = ("source",)
    order: ClassVar = 30
    shown_by: ClassVar = "overlap"

    overlap_removal: str = option(
        "raw",
        "raw: round(lambda |P1|) overlapping points of the raw scans (paper); noisy: down to the "
        "absolute ratio round(O - lambda, 2) after the noise (released code)",
        choices=("raw", "noisy"),
    )
    overlap_shape: str = option(
        "scattered",
        "Which overlapping points go. scattered: drawn one by one (paper); sector: all within an "
        "azimuth sector about the source's z axis that begins at an azimuth drawn for each noise "
        "draw",
        choices=("scattered", "sector"),
        variant=True,
    )

    @property
    def drawn(self) -> tuple[str, str] | tuple[()]:
        if self.overlap_shape == "sector":
            return ("azimuth", "of the removed sector")
        return super().drawn

    @property
    def drawn_once(self) -> bool:
        return self.overlap_shape == "scattered"

    @property
    def conflict(self) -> str:
        if self.overlap_shape == "sector" and self.overlap_removal == "noisy":
            return (
                "overlap_shape: sector removes rows of the raw source, which overlap_removal: "
                "noisy replaces by others. Hint: use overlap_removal: raw"
            )
        return ""

    @property
    def replaces(self) -> bool:
        """The released code brings the noisy overlap to a rounded ratio even at lambda 0."""
        return self.overlap_removal == "noisy"

    def check(self, pair: RawPair, level: float) -> None:
        if level > pair.overlap:
            raise PerturbationError(
                f"partial_overlap {level} is larger than their overlap ratio {pair.overlap:.4f}.\n"
                "Hint: choose smaller levels of partial_overlap, or other pairs."
            )

    def keep(
        self, pair: RawPair, scan: str, level: float, draw: int, streams: Streams
    ) -> np.ndarray:
        kept = np.ones(len(pair.source), dtype=bool)
        if self.overlap_removal == "raw":
            order = self._raw_order(pair, draw, streams)
            count = round(level * len(pair.reference))
            if count > len(order):
                raise PerturbationError(
                    f"partial_overlap {level} would remove {count} source points, "
                    f"but only {len(order)} overlap (overlap ratio {pair.overlap:.4f}).\n"
                    "Hint: partial_overlap must be at most "
                    f"{len(order) / len(pair.reference):.4f} here."
                )
            kept[order[:count]] = False
        return kept

    def replace(
        self,
        pair: RawPair,
        reference: np.ndarray,
        source: np.ndarray,
        level: float,
        streams: Streams,
    ) -> np.ndarray:
        """The released code's rule: the noisy overlap is brought to a fixed ratio.

        The target is round(O - level, 2) with O of the clean scans; within 1e-3 of the clean or
        the noisy ratio nothing is done; where the noise left too little overlap, reference points
        are copied with N(0, 1 mm).
        """
        target = round(pair.overlap - level, 2)
        if self.overlap_removal == "raw" or abs(target - pair.overlap) < CLOSE_ENOUGH:
            return source
        if target < 0:
            raise PerturbationError(
                f"partial_overlap {level} is larger than the overlap ratio {pair.overlap:.4f}.\n"
                "Hint: choose a smaller partial_overlap for this pair."
            )
        T_reference_source = pair.T_reference_source
        near = nearest_distances(reference, source, T_reference_source) <= pair.overlap_distance
        if abs(near.sum() / len(reference) - target) < CLOSE_ENOUGH:
            return source
        surplus = round(near.sum() - target * len(reference))
        if surplus >= 0:
            return np.delete(source, self._order(near, streams)[:surplus], axis=0)
        T_source_reference = se3.inverse(T_reference_source)
        far = nearest_distances(source, reference, T_source_reference) > pair.overlap_distance
        generator = streams.generator("overlap")
        copied = generator.permutation(np.flatnonzero(far))[:-surplus]
        jitter = generator.normal(scale=JITTER, size=(len(copied), 3))
        return np.vstack([source, se3.transform(T_source_reference, reference[copied]) + jitter])

    def _order(self, overlapping, streams):
        """Rows of the overlapping source points in the order in which a growing lambda goes."""
        return streams.generator("overlap").permutation(np.flatnonzero(overlapping))

    def _raw_order(self, pair, draw, streams):
        """The same of the raw scans, in a noise draw."""
        if self.overlap_shape == "scattered":
            return self._order(pair.overlapping, streams)
        rows, azimuths = _by_azimuth(pair)
        start = streams.generator(f"overlap_sector/{draw}").uniform(-np.pi, np.pi)
        return np.roll(rows, -np.searchsorted(azimuths, start))


@lru_cache(maxsize=1)
def _by_azimuth(pair):
    """Rows of the overlapping source points by rising azimuth about the source's z axis [rad]."""
    rows = np.flatnonzero(pair.overlapping)
    azimuths = np.arctan2(pair.source[rows, 1], pair.source[rows, 0])
    order = np.argsort(azimuths, kind="stable")
    return rows[order], azimuths[order]
