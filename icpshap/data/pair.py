"""A pair of scans: read from its tables, measured, and checked before anything is registered."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from icpshap import se3, storage, tables
from icpshap.data import ground_truth
from icpshap.data.scans import check_scan
from icpshap.errors import DataError, PerturbationError
from icpshap.geometry import nearest_distances, root_mean_square_distance

if TYPE_CHECKING:
    from icpshap.causes.cause import Cause


log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two raw scans (n, 3) and (m, 3) [m], each in its scanner's frame, and the true pose.

    `overlapping` (m,) marks the source points that have a reference point within the distance
    `overlap_distance` [m] at that pose; `source_times` (m,): when each source point was measured,
    None where the scan does not say; `minimum_range` [m]: points of either scan nearer to their
    scanner are left out by the chain, which the causes may have to know. A pair equals itself only,
    so that what is computed from it can be kept.
    """

    reference: np.ndarray
    source: np.ndarray
    T_reference_source: np.ndarray
    overlapping: np.ndarray
    overlap_distance: float
    source_times: np.ndarray | None = None
    minimum_range: float = 0.0

    @classmethod
    def measured(
        cls,
        reference: np.ndarray,
        source: np.ndarray,
        T_reference_source: np.ndarray,
        overlap_distance: float,
        source_times: np.ndarray | None = None,
    ) -> Pair:
        """The pair of two scans (n, 3), (m, 3) [m], whose overlap is measured at T (4, 4)."""
        distances = nearest_distances(reference, source, T_reference_source)
        return cls(
            reference,
            source,
            T_reference_source,
            distances <= overlap_distance,
            overlap_distance,
            source_times,
        )

    def for_chain(self, minimum_range: float) -> Pair:
        """The pair for a chain with this minimum range [m]."""
        if self.minimum_range == minimum_range:
            return self
        return replace(self, minimum_range=minimum_range)

    @property
    def overlap(self) -> float:
        """Overlap ratio O = N / |P1| (section "Partial Overlap")."""
        return self.overlapping.sum() / len(self.reference)

    @property
    def overlap_in_range(self) -> np.ndarray:
        """Mask (m,) of the overlapping source points beyond the chain's minimum range."""
        return self.overlapping & (np.linalg.norm(self.source, axis=1) > self.minimum_range)

    @cached_property
    def at_truth(self) -> ground_truth.Fit:
        """How near the scans beyond the chain's minimum range lie at the true pose."""
        return ground_truth.measured(
            self.reference, self.source, self.T_reference_source, self.minimum_range
        )

    @property
    def characteristic_length(self) -> float:
        """L [m], at which a rotation counts as what it moves; NaN without overlap.

        Root mean square distance of the points of `overlap_in_range` from their centroid.
        """
        return root_mean_square_distance(self.source[self.overlap_in_range])


class Pairs:
    """The pairs of a sequence, read from the files of its scans, of its poses and of overlaps.

    Each file of scans or overlaps holds several; they may be given in any order.
    """

    def __init__(
        self, scans: Iterable[str | Path], poses: str | Path, overlaps: Collection[str | Path] = ()
    ) -> None:
        self._scans = storage.parts_of(scans)
        self._overlaps = storage.parts_of(overlaps)
        self._distances = {path: tables.read_about(path)["plan"]["distance"] for path in overlaps}
        self._T_global_scan = tables.read_poses(poses)
        # Scans follow one another in the pairs of a sequence.
        self._read = lru_cache(maxsize=2)(self._load)

    def measured(self, indices: tuple[int, int], distance: float) -> Pair:
        """The `Pair` of reference and source scan, whose overlap within `distance` is measured."""
        (reference, _), (source, times) = map(self._read, indices)
        T = relative_pose(self._T_global_scan, *indices)
        return Pair.measured(reference, source, T, distance, times)

    def read(self, indices: tuple[int, int]) -> Pair:
        """The same with the overlap that was measured. Raises DataError if it is of other scans."""
        (reference, _), (source, times) = map(self._read, indices)
        path, _ = self._overlaps[tables.pair_part(indices)]
        overlapping = tables.read_overlap(path, indices)
        if len(overlapping) != len(source):
            raise DataError(
                f"{path}: {len(overlapping)} marks of overlap for {len(source)} points of scan"
                f" {indices[1]}.",
                "it belongs to another pair; remove it, and the workflow makes it again.",
            )
        T = relative_pose(self._T_global_scan, *indices)
        return Pair(reference, source, T, overlapping, self._distances[path], times)

    def data(self, pairs: Iterable[tuple[int, int]]) -> dict[str, str]:
        """Digest of each scan of `pairs` by its name."""
        names = [tables.scan_part(index) for index in sorted({k for pair in pairs for k in pair})]
        return {name: self._scans[name][1]["digest"] for name in names}

    def _load(self, index):
        path, _ = self._scans[tables.scan_part(index)]
        return tables.read_scan(path, index)


def relative_pose(T_global_scan: np.ndarray, reference: int, source: int) -> np.ndarray:
    """T_reference_source (4, 4) of two scans out of all poses (n, 4, 4)."""
    return se3.inverse(T_global_scan[reference]) @ T_global_scan[source]


def describe_pair(
    pair: Pair,
    sequence: str,
    indices: tuple[int, int],
    *,
    levels: Iterable[tuple[Cause, float]],
    minimum_overlap: float,
    minimum_range: float,
    truth: str = "",
) -> dict[str, Any]:
    """A row of the pairs table, by column.

    levels: cause and its largest level, for each that will be on; minimum_overlap: a pair whose
    overlap ratio is not above it is not registered; minimum_range: the chain's [m]; truth: what is
    to be said of how the true pose was found. Raises DataError for a scan with too few points
    beyond the range, PerturbationError for a level that cannot be applied to the pair.
    """
    reference, source = indices
    for index, points in ((reference, pair.reference), (source, pair.source)):
        check_scan(points, minimum_range, f"{sequence}, scan {index}")
    pair = pair.for_chain(minimum_range)
    reason = _not_registered(pair, minimum_overlap)
    registered = not reason
    for cause, level in levels if registered else ():
        try:
            cause.check(pair, level)
        except PerturbationError as error:
            where = f"{sequence}, scans {reference} and {source}"
            raise PerturbationError(f"{where}: {error}") from None
    distance = pair.at_truth.distance
    log.info("overlap %.4f, median distance at the true pose %.4f m", pair.overlap, distance)
    warning = "; ".join(filter(None, (ground_truth.warning(pair.at_truth), truth)))
    if pair.overlap > 1:
        more = (
            f"the overlap ratio is {pair.overlap:.2f}, above 1: the source has more points than the"
            " reference, by whose number it is counted, as lambda is"
        )
        warning = "; ".join(filter(None, (warning, more)))
    for remark in filter(None, (reason, warning)):
        log.warning(remark)
    return {
        "sequence": sequence,
        "reference": reference,
        "source": source,
        "reference_points": len(pair.reference),
        "source_points": len(pair.source),
        "overlap": pair.overlap,
        "characteristic_length": pair.characteristic_length,
        **dict(zip(tables.TRANSFORM, pair.T_reference_source.ravel(), strict=True)),
        "median_distance": distance,
        "registered": registered,
        "reason": reason,
        "warning": warning,
    }


def _not_registered(pair, minimum_overlap):
    """Why a pair is not registered; "" if it is."""
    if not pair.overlap > minimum_overlap:
        return f"overlap ratio {pair.overlap:.4f} is not above {minimum_overlap}"
    if not pair.overlap_in_range.any():
        return f"all overlap lies within minimum_range, {pair.minimum_range:g} m, of the scanner"
    return ""
