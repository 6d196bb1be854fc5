"""The covariance of ICP by an unscented transform of its initial pose, plus that of the noise.

Brossard, Bonnabel, Barrau, "A new approach to 3D ICP covariance estimation" (RA-L 2020).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from icpshap import se3
from icpshap.estimators import perturb
from icpshap.estimators.closed_form import ClosedForm
from icpshap.estimators.kind import GOOD_STATUS, Covariance, of_definite
from icpshap.options import option

if TYPE_CHECKING:
    from icpshap.estimators.kind import Returns
    from icpshap.estimators.perturb import Group


SIGMA_POINTS = 13
FAR_TRANSLATION, FAR_ROTATION = 0.1, np.deg2rad(2.0)  # m, rad; one such point is 1/12 of all


@dataclass(frozen=True)
class Unscented(ClosedForm):
    """Registrations from 13 sigma points of the initial pose, and the closed form at the first end.

    C = P + white + bias: P, the scatter of the ends about the first one, of which the initial pose
    is the true one; white, the closed form there; bias, of an error that all points share, along
    the normals. One registration that fails fails the setting. Where each run has a mask of its
    own, sigma point n of noise draw k has that of run 13 k + n.
    """

    name: ClassVar = "unscented"

    composition: str = option(
        "right",
        "Sigma points and scatter on the right of the pose, T exp(xi), or on its left, exp(xi) T "
        "(released code)",
        choices=("right", "left"),
    )
    bias: bool = option(
        False,
        "Whether the covariance has that of a constant bias of both clouds along the normals, as "
        "large as the noise; it hides what other causes do",
    )

    def spread(self, noise_draws: int) -> str:
        bias = " and of a bias of all points as large" * self.bias
        return (
            "The covariance is the scatter of the ends of 12 sigma points of the initial pose "
            "about that of the true one, and what white noise of the points"
            f"{bias} does there in closed form, {self._told} (Brossard)."
        )

    def returned(self, noise_draws: int) -> Returns:
        # How much of it the sensor's own noise makes is not kept apart.
        return self.returns

    @property
    def made_of(self) -> str:
        bias = ", and a bias" * self.bias
        return f"scatter of {SIGMA_POINTS} sigma points, and {super().made_of}{bias}"

    @property
    def conflict(self) -> str:
        if self.bias and self.metric == "point_to_point":
            return (
                "bias: is along the normals, which point_to_point has none of. "
                "Hint: bias: false, or metric: point_to_plane"
            )
        return ""

    def number_of_runs(self, noise_draws: int) -> int:
        return SIGMA_POINTS * noise_draws

    def estimate(self, group: Group) -> Iterator[Covariance]:
        from icpshap import icp

        reference = self.reference(group.reference)
        T_true = group.pair.T_reference_source
        for same in perturb.alike(group.starts):
            T_initial = [
                composed(T_true, sigma_points(start.initial_deviation), self.composition)
                for start in same
            ]
            rows = [run for start in same for run in start.rows]
            runs = icp.register(
                reference, same[0].source, rows, np.concatenate(T_initial), self.chain()
            )
            # The first sigma point of all of them is the true pose, with the same rows.
            T = runs.T_reference_source[0]
            white = self.at(group, reference, same[0], T, runs.status[0])
            added = white.covariance + white.bias if self.bias else white.covariance
            for k, start in enumerate(same):
                part = slice(k * SIGMA_POINTS, (k + 1) * SIGMA_POINTS)
                covariance = scatter(runs.T_reference_source[part], self.composition) + added
                status = worst([*runs.status[part], white.status])
                if status in GOOD_STATUS:
                    status = of_definite(status, covariance)
                if status not in GOOD_STATUS:
                    covariance = np.full((6, 6), np.nan)
                yield Covariance(
                    start.setting,
                    group.noise_draw,
                    T,
                    covariance,
                    runs.iterations[part].max(),
                    status,
                    white.rmse,
                    white.inlier_ratio,
                    far(runs.T_reference_source[part]),
                )


# --- the mathematics ------------------------------------------------------------------------------


def sigma_points(deviation: np.ndarray) -> np.ndarray:
    """Sigma points xi (13, 6) of independent coordinates of that standard deviation (6,).

    0, and plus and minus the rows of the Cholesky factor of 6 times the covariance.
    """
    rows = np.sqrt(6.0) * np.diag(deviation)
    return np.concatenate([np.zeros((1, 6)), rows, -rows])


def composed(T: np.ndarray, xi: np.ndarray, composition: str) -> np.ndarray:
    """Poses (k, 4, 4) at xi (k, 6) from the pose T (4, 4), on its right or on its left."""
    return T @ se3.exp(xi) if composition == "right" else se3.exp(xi) @ T


def scatter(T: np.ndarray, composition: str) -> np.ndarray:
    """Sum of xi xi^T / 12 (6, 6) over the poses T (13, 4, 4), about the first: on its right.

    xi is taken on the right of the first pose, or on its left and then moved to the right; it is
    not centred on its mean.
    """
    inverse = se3.inverse(T[0])
    if composition == "right":
        xi = se3.log(inverse @ T[1:])
    else:
        xi = se3.log(T[1:] @ inverse) @ se3.adjoint(inverse).T
    return xi.T @ xi / len(xi)


def far(T: np.ndarray) -> int:
    """How many of the ends T (13, 4, 4) lie in another basin than the first, whatever the noise."""
    xi = se3.log(se3.inverse(T[0]) @ T[1:])
    beyond = np.linalg.norm(xi[:, :3], axis=1) > FAR_ROTATION
    return int(np.count_nonzero(beyond | (np.linalg.norm(xi[:, 3:], axis=1) > FAR_TRANSLATION)))


def worst(status: Iterable[str]) -> str:
    """The status of an estimate that many registrations make: one that failed, or did not rest."""
    for state in ("too_few_links", "degenerate", "max_iterations"):
        if state in status:
            return state
    return "ok"
