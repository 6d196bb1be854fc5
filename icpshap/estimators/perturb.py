"""How the uncertainty sources act on a pair of scans.

The sources act independently of one another and on the raw scans; the ICP chain filters afterwards
(range filter, then subsampling). Every random number comes from a named stream of its own, and the
same draws serve every setting of a pair (common random numbers): noise is sigma times one standard
normal draw, xi is sqrt(s) times one draw, masks are drawn on the rows of the raw scan, so that a
removed point shifts no other.
"""

from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from scipy.spatial import KDTree

from icpshap import se3
from icpshap.errors import UserError


class PerturbationError(UserError):
    """A perturbation cannot be applied to a pair of scans."""


@dataclass(frozen=True)
class Pair:
    """Two raw scans (n, 3) and (m, 3) [m], each in its scanner's frame, and the true pose.

    `overlapping` (m,) marks the source points that have a reference point near them at that pose.
    """

    reference: np.ndarray
    source: np.ndarray
    T_reference_source: np.ndarray
    overlapping: np.ndarray

    @property
    def overlap(self):
        """Overlap ratio O = N / |P1| (section "Partial Overlap")."""
        return self.overlapping.sum() / len(self.reference)


@dataclass(frozen=True)
class Streams:
    """The random numbers of a pair, by name; `branch` names an independent set of draws."""

    seed: int
    sequence: str
    reference: int
    source: int
    branch: str = ""

    def branched(self, branch):
        return replace(self, branch=branch)

    def generator(self, name):
        words = (crc32(self.sequence.encode()), self.reference, self.source)
        stream = crc32(f"{self.branch}{name}".encode())
        return np.random.default_rng(np.random.SeedSequence([self.seed, *words, stream]))


def nearest_distances(reference, source, T_reference_source):
    """Distance [m] of each source point (m, 3) to the nearest reference point at the given pose."""
    distances, _ = KDTree(reference).query(se3.transform(T_reference_source, source))
    return distances


def initial_poses(T_reference_source, scale, draw, deviation, scaling, composition):
    """Initial poses around the true one, Eq. 4.

    draw (n, 6) is standard normal, deviation (6,) the standard deviation at scale 1 [rad, m].
    Returns xi (n, 6) and T_init (n, 4, 4).
    """
    factor = np.sqrt(scale) if scaling == "covariance" else scale
    xi = factor * deviation * draw
    if composition == "right":
        return xi, T_reference_source @ se3.exp(xi)
    return xi, se3.exp(-xi) @ T_reference_source


def overlap_order(overlapping, generator):
    """Rows of the overlapping source points in the order in which a growing lambda removes them."""
    return generator.permutation(np.flatnonzero(overlapping))


def reduce_overlap(pair, reduction, order):
    """Mask (m,) of the source points that are left when the overlap ratio falls by `reduction`.

    A larger reduction removes a superset. Raises PerturbationError if fewer points overlap.
    """
    count = round(reduction * len(pair.reference))
    if count > len(order):
        raise PerturbationError(
            f"partial_overlap {reduction} would remove {count} source points, "
            f"but only {len(order)} overlap (overlap ratio {pair.overlap:.4f}).\n"
            f"Hint: partial_overlap must be at most {len(order) / len(pair.reference):.4f} here."
        )
    kept = np.ones(len(pair.source), dtype=bool)
    kept[order[:count]] = False
    return kept


def set_overlap(pair, reference, source, reduction, distance, generator):
    """Source points after the released code's rule: the noisy overlap is brought to a fixed ratio.

    The target is round(O - reduction, 2) with O of the clean scans; within 1e-3 of the clean or
    the noisy ratio nothing is done; where the noise left too little overlap, reference points are
    copied with N(0, 1 mm). reference (n, 3) and source (m, 3) [m] are the noisy scans. Raises
    PerturbationError as `reduce_overlap` does.
    """
    target = round(pair.overlap - reduction, 2)
    if abs(target - pair.overlap) < 1e-3:
        return source
    if target < 0:
        raise PerturbationError(
            f"partial_overlap {reduction} is larger than the overlap ratio {pair.overlap:.4f}.\n"
            "Hint: choose a smaller partial_overlap for this pair."
        )
    overlapping = nearest_distances(reference, source, pair.T_reference_source) <= distance
    if abs(overlapping.sum() / len(reference) - target) < 1e-3:
        return source
    surplus = round(overlapping.sum() - target * len(reference))
    if surplus >= 0:
        removed = overlap_order(overlapping, generator)[:surplus]
        return np.delete(source, removed, axis=0)
    T_source_reference = se3.inverse(pair.T_reference_source)
    far = nearest_distances(source, reference, T_source_reference) > distance
    copied = generator.permutation(np.flatnonzero(far))[:-surplus]
    jitter = generator.normal(scale=0.001, size=(len(copied), 3))
    return np.vstack([source, se3.transform(T_source_reference, reference[copied]) + jitter])


def subsample(count, probability, generator):
    """Rows out of `count` that random subsampling keeps, in ascending order.

    Drawn as gaps between kept rows, which are geometric: the law is that of one coin per row.
    """
    if probability == 1:
        return np.arange(count)
    expected = count * probability
    size = int(expected + 6 * np.sqrt(expected) + 10)
    rows = np.cumsum(generator.geometric(probability, size)) - 1
    while rows[-1] < count:
        more = np.cumsum(generator.geometric(probability, size))
        rows = np.concatenate([rows, rows[-1] + more])
    return rows[rows < count]
