"""The covariance of pairs that look alike: of the nearest ones for which ICP ran many times.

Landry, Pomerleau, Giguère, "CELLO-3D: Estimating the Covariance of ICP in the Real World" (ICRA
2019), with the distance as it is instead of a learned metric. A training example is one setting of
one pair: the descriptor of its perturbed clouds, and the covariance of its runs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

import numpy as np

from icpshap.errors import UserError
from icpshap.estimators import perturb
from icpshap.estimators._descriptors import descriptor
from icpshap.estimators.kind import COVARIANCES, UNSHARED, Covariance, Kind, of_definite
from icpshap.options import option
from icpshap.tables import DESCRIPTOR, PAIR, covariances

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.estimators.perturb import Group


class TrainingError(UserError):
    """There is nothing, or too little, to learn from."""


class Examples(NamedTuple):
    """What a covariance is predicted from: n examples.

    descriptors (n, d), of which each entry is divided by its standard deviation over the examples;
    scale (d,): one over that, 0 for an entry in which they do not differ and which tells nothing;
    covariances (n, 6, 6) [rad, m].
    """

    descriptors: np.ndarray
    scale: np.ndarray
    covariances: np.ndarray

    @classmethod
    def of(cls, descriptors: np.ndarray, covariances: np.ndarray) -> Examples:
        """Those of descriptors (n, d) as they are, and covariances (n, 6, 6)."""
        differ = np.ptp(descriptors, axis=0) > 0
        scale = np.where(differ, 1 / np.where(differ, descriptors.std(axis=0), 1.0), 0.0)
        return cls(descriptors * scale, scale, covariances)


@dataclass(frozen=True)
class Learned(Kind):
    """The weighted mean covariance of the nearest training examples, at the true pose.

    It registers nothing, and sees the clouds alone: of causes that act on the runs only, the
    initial pose and ICP's own randomness, it says 0, and the covariances that it was trained on
    are of all their levels. All usable points make the descriptor, whatever the subsample is; where
    the clouds hardly overlap, the setting is `degenerate`.
    """

    name: ClassVar = "learned"
    returns: ClassVar = COVARIANCES
    sees: ClassVar = UNSHARED
    fewest_pairs: ClassVar = 30

    training: str = option(
        "same_perturbation",
        "Experiment from whose runs it learns: those of all its sequences but the one that is "
        f"estimated, which must have {fewest_pairs} pairs at least",
    )
    neighbours: int = option(
        12,
        "Training examples, the nearest ones, of whose covariances the mean is taken",
        unit="-",
        minimum=1,
        maximum=10_000,
    )

    examples: Examples | None = field(default=None, repr=False, compare=False)

    @property
    def made_of(self) -> str:
        return "covariances of pairs that look alike"

    def spread(self, noise_draws: int) -> str:
        return (
            f"The covariance is the mean of those of the {self.neighbours} settings of "
            f"{self.training} that look most alike, in other sequences (CELLO-3D); it was told no "
            "noise but what those runs had."
        )

    def trained(self, table: pd.DataFrame, leave_out: str) -> Self:
        """The same with the examples of a descriptors table (tables.TABLES).

        leave_out: key of the sequence that is to be estimated, whose own pairs are no examples.
        Raises TrainingError if fewer than `fewest_pairs` pairs are left.
        """
        others = table[table["sequence"] != leave_out]
        pairs = len(others[PAIR].drop_duplicates())
        if pairs < self.fewest_pairs:
            raise TrainingError(
                f"{self.training} has runs of {pairs} pairs of other sequences than {leave_out} to "
                f"learn from, expected at least {self.fewest_pairs}.\n"
                f"Hint: more sequences, or more scans, in {self.training}; its pairs.parquet says "
                "why pairs were not registered."
            )
        descriptors = others[DESCRIPTOR].to_numpy(dtype=float)
        return replace(self, examples=Examples.of(descriptors, covariances(others)))

    def estimate(self, group: Group) -> Iterator[Covariance]:
        if self.examples is None:
            raise TrainingError(
                f"The kind {self.name} was not trained.\n"
                "Hint: call trained(table, leave_out) first, with what the workflow writes to "
                f"results/{self.training}/<sequence>/descriptors.parquet."
            )
        for same, seen in descriptors(group):
            status, covariance = "degenerate", np.full((6, 6), np.nan)
            if seen is not None:
                covariance = predict(self.examples, seen, self.neighbours)
                status = of_definite("ok", covariance)
            for start in same:
                T = group.pair.T_reference_source
                yield Covariance(start.setting, group.noise_draw, T, covariance, status=status)


def descriptors(group: Group) -> Iterator[tuple[list[perturb.Start], np.ndarray | None]]:
    """Yields the starts of a perturb.Group that have the same clouds, and their descriptor (d,).

    None in its place where the clouds hardly overlap.
    """
    T_reference_source = group.pair.T_reference_source
    for same in perturb.alike(group.starts, "usable"):
        points = same[0].source[same[0].usable]
        yield same, descriptor(group.reference, points, T_reference_source)


def predict(examples: Examples, seen: np.ndarray, neighbours: int) -> np.ndarray:
    """The covariance (6, 6) [rad, m] of a pair with the descriptor `seen` (d,).

    C = sum_i e^-d_i C_i / sum_i e^-d_i over the nearest `Examples`, of which d_i is the Euclidean
    distance between descriptors that are divided by the examples' standard deviations. Of examples
    as far as one another the first count. A mean of positive definite matrices is one.
    """
    distance = np.linalg.norm(examples.descriptors - seen * examples.scale, axis=1)
    nearest = np.argsort(distance, kind="stable")[:neighbours]
    # Relative to the nearest: else all weights of a pair unlike any other would vanish.
    weight = np.exp(distance[nearest[0]] - distance[nearest])
    return np.tensordot(weight / weight.sum(), examples.covariances[nearest], 1)
