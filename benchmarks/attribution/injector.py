"""Degrade pairs of scans on purpose, by mechanisms that share no code with the causes.

Frozen: mechanisms, ranges, numbers and seeds were written down before there was anything that
explains, and stay as they are; only then does it say something that an explanation finds what was
done. What is *told* of a case is what a robot knows of its own configuration: how far off its
initial poses are, and how few points it takes. All else must be seen in the scans.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from icpshap.data import simulate

FIRST_SEED = 20261130
SCENES = ("apartment", "corridor", "hall", "plain", "stairwell", "street")
# Beams, and options of simulate_scan, by scanner.
SCANNERS = {"tilting": (40_000, {}), "spinning": (57_600, {"rings": 32})}
SCANS = 10  # of a sequence
NEIGHBOURS = 12  # of a normal
OVERLAP_DISTANCE = 0.2  # m

# Levels, log-uniform; of shares, that of what remains.
RANGES = {
    "sensor_noise": (0.015, 0.06),  # m
    "partial_overlap": (0.08, 0.5),  # of the overlap remains
    "under_constrained": (0.003, 0.2),  # of the information remains
    "icp_randomness": (3.0, 16.0),  # times fewer points
    "initial_pose": (4.0, 16.0),  # times the variance
}
MEASURED = ("sensor_noise", "partial_overlap", "under_constrained")
TOLD = ("icp_randomness", "initial_pose")
# Mechanisms that no explainer knows, by the cause that they are an instance of.
UNKNOWN = {"beam_noise": "sensor_noise", "cone": "partial_overlap", "bare": "under_constrained"}


class Sequence(NamedTuple):
    """Clean scans of one scanner in one scene, and their poses T_global_scan."""

    scene: str
    scanner: str
    clouds: list
    poses: np.ndarray

    def T(self, pair):
        """T_reference_source (4, 4) of scans pair and pair + 1."""
        return np.linalg.solve(self.poses[pair], self.poses[pair + 1])


class Case(NamedTuple):
    """A degraded pair; parts: level by mechanism, a cause's name or one of `UNKNOWN`.

    pair: index of the reference; number: from which its random numbers come.
    """

    sequence: Sequence
    pair: int
    parts: dict
    number: int
    seed: int

    def cause(self, part):
        """The cause that a mechanism is an instance of."""
        return UNKNOWN.get(part, part)

    def told(self, without=None):
        """Scale of the initial pose's variance and divisor of the points."""
        parts = {name: level for name, level in self.parts.items() if name != without}
        return parts.get("initial_pose", 1.0), parts.get("icp_randomness", 1.0)

    def clouds(self, without=None):
        """Reference (n, 3) and source (m, 3) as they are measured; `without` a part.

        Each part has random numbers of its own, so that what is left out changes no other.
        """
        reference, source = self.sequence.clouds[self.pair : self.pair + 2]
        T = self.sequence.T(self.pair)
        kept = [np.ones(len(reference), dtype=bool), np.ones(len(source), dtype=bool)]
        shifts = [0.0, 0.0]
        for name, level in self.parts.items():
            if name == without or name in TOLD:
                continue
            generator = np.random.default_rng(
                [self.seed, self.number, sum(map(ord, name)), len(name)]
            )
            if name in NOISES:
                shifts = [NOISES[name](cloud, level, generator) for cloud in (reference, source)]
            else:
                left = REMOVALS[name](reference, source, T, level, generator)
                kept = [mine & other for mine, other in zip(kept, left, strict=True)]
        return [
            (cloud + shift)[mask]
            for cloud, shift, mask in zip((reference, source), shifts, kept, strict=True)
        ]


def sequence(scene, scanner, seed):
    beams, options = SCANNERS[scanner]
    poses = simulate.simulate_poses(scene, SCANS, seed)
    clouds = [
        simulate.simulate_scan(scene, k, poses[k], beams, seed, **options) for k in range(SCANS)
    ]
    return Sequence(scene, scanner, clouds, poses)


def single_cases(sequences, seed, mechanisms=(*MEASURED, *TOLD)):
    """Each mechanism alone, on every pair of every sequence."""
    return _cases(sequences, seed, 0, [(name,) for name in mechanisms])


def unknown_cases(sequences, seed):
    return _cases(sequences, seed, 1, [(name,) for name in UNKNOWN])


def mixtures(sequences, seed):
    """Two or three causes together, drawn anew for every pair."""
    return _cases(sequences, seed, 2, None)


def _cases(sequences, seed, group, combinations):
    cases = []
    for of in sequences:
        for pair in range(SCANS - 1):
            place = len(cases) + 100_000 * group
            generator = np.random.default_rng([seed, place])
            drawn = combinations
            if drawn is None:
                number = generator.integers(2, 4)
                drawn = [tuple(generator.choice((*MEASURED, *TOLD), number, replace=False))]
            for names in drawn:
                parts = {str(name): _level(str(name), generator) for name in names}
                cases.append(Case(of, pair, parts, len(cases) + 100_000 * group, seed))
    return cases


def _level(name, generator):
    low, high = np.log(RANGES[UNKNOWN.get(name, name)])
    value = float(np.exp(generator.uniform(low, high)))
    return 1.0 - value if UNKNOWN.get(name, name) in MEASURED[1:] else value


# --- mechanisms -----------------------------------------------------------------------------------


def _white(cloud, level, generator):
    return generator.normal(0.0, level, cloud.shape)


def _along_the_beam(cloud, level, generator):
    """Errors of the range alone, of the same mean square as white noise of this level."""
    beams = cloud / np.linalg.norm(cloud, axis=1, keepdims=True)
    return np.sqrt(3) * level * generator.standard_normal((len(cloud), 1)) * beams


def _sector(reference, source, T, level, generator):
    """Nothing returns out of a sector of azimuth, which is as wide as the level wants."""
    azimuth = np.arctan2(source[:, 1], source[:, 0])
    apart = np.abs(np.angle(np.exp(1j * (azimuth - generator.uniform(-np.pi, np.pi)))))
    return _until_gone(reference, source, T, level, apart)


def _cone(reference, source, T, level, generator):
    """Nothing returns out of a cone about a beam."""
    axis = source[generator.integers(len(source))]
    cosine = source @ axis / (np.linalg.norm(source, axis=1) * np.linalg.norm(axis))
    return _until_gone(reference, source, T, level, -cosine)


def _until_gone(reference, source, T, level, order):
    """Source points in a rising order go until that share of the overlapping ones is gone."""
    moved = source @ T[:3, :3].T + T[:3, 3]
    overlapping = cKDTree(reference).query(moved)[0] <= OVERLAP_DISTANCE
    limit = np.quantile(order[overlapping], level)
    return np.ones(len(reference), dtype=bool), order > limit


def _weak(reference, source, T, level, generator):
    """Of both scans goes what holds the least held direction of the translation."""
    mine, other = _normals(source) @ T[:3, :3].T, _normals(reference)
    direction = np.linalg.eigh(mine.T @ mine)[1][:, 0]
    return _without(other @ direction, level), _without(mine @ direction, level)


def _bare(reference, source, T, level, generator):
    """Of both scans goes what faces a horizontal direction, as between two bare walls."""
    angle = generator.uniform(0.0, np.pi)
    direction = np.array([np.cos(angle), np.sin(angle), 0.0])
    mine, other = _normals(source) @ T[:3, :3].T, _normals(reference)
    return _without(other @ direction, level), _without(mine @ direction, level)


def _without(along, level):
    """Mask without the largest squares, until their sum is less by that share."""
    square = along**2
    order = np.argsort(-square)
    gone = np.cumsum(square[order]) / square.sum()
    kept = np.ones(len(along), dtype=bool)
    kept[order[: np.searchsorted(gone, level)]] = False
    return kept


def _normals(cloud):
    _, nearest = cKDTree(cloud).query(cloud, NEIGHBOURS)
    centred = cloud[nearest] - cloud[nearest].mean(axis=1, keepdims=True)
    return np.linalg.svd(centred, full_matrices=False)[2][:, 2]


NOISES = {"sensor_noise": _white, "beam_noise": _along_the_beam}
REMOVALS = {
    "partial_overlap": _sector,
    "cone": _cone,
    "under_constrained": _weak,
    "bare": _bare,
}
