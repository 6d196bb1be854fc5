"""What a kind of estimator is: a class of options that turns groups of settings into estimates.

A kind is one file of this package, found by being there; `kind: monte_carlo` names it. It says in
`returns` what comes back, and those who read its tables ask there instead of assuming.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, ClassVar, NamedTuple, Self

import numpy as np

from icpshap.plan import Setting

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.estimators.perturb import Group


GOOD_STATUS = ("ok", "max_iterations")  # of the runs and estimates that count


@dataclass(frozen=True)
class Returns:
    """What an estimator makes of a setting: pose samples, covariances, or both.

    exchangeable: whether its samples of one noise draw are independent of one another and alike, so
    that one of them left out says how sure the rest are; chain: whether those of one draw are the
    states of a Markov chain, in their order. sensor_sigma [m]: the sensor's own noise,
    if it is in the spread (0: it is not), and in which part: in the scatter of the noise draws
    (`drawn`) or in the covariances; together with the sensor noise of the setting, or alone.
    """

    samples: bool
    covariances: bool
    exchangeable: bool = False
    chain: bool = False
    sensor_sigma: float = 0.0
    drawn: bool = False
    together: bool = True

    @property
    def is_deterministic(self) -> bool:
        """Whether nothing but the noise draw varies: equal clouds give equal estimates."""
        return not self.samples

    def units(self, noise_draws: int) -> str:
        """What may be left out to see how sure an estimate is: runs, noise draws, nothing ("")."""
        if noise_draws > 1:
            return "noise draws"
        return "runs" if self.exchangeable else ""


SAMPLES = Returns(samples=True, covariances=False, exchangeable=True)
COVARIANCES = Returns(samples=False, covariances=True)

# What an estimator can see that is told the noise, or reads it off single residuals: not an error
# that all points of a scan share, which moves the estimate and leaves its covariance as it is.
UNSHARED = (
    "sensor_noise",
    "initial_pose",
    "partial_overlap",
    "under_constrained",
    "icp_randomness",
)


class Samples(NamedTuple):
    """Poses of a setting in one noise draw: k of them, numbered by `runs` (k,).

    T_reference_source (k, 4, 4); initial_xi (k, 6): error of the pose that each began at; weight
    (k,): relative, with mean 1; iterations, status, rmse [m], inlier_ratio (k,).
    """

    setting: Setting
    noise_draw: int
    runs: np.ndarray
    T_reference_source: np.ndarray
    initial_xi: np.ndarray
    iterations: np.ndarray
    status: np.ndarray
    rmse: np.ndarray
    inlier_ratio: np.ndarray
    weight: np.ndarray | float = 1.0


class Covariance(NamedTuple):
    """The covariance (6, 6) [rad, m] of one estimate T_reference_source (4, 4).

    Of xi in T exp(xi), rotation first; iterations, status, rmse [m], inlier_ratio: numbers; far: of
    the registrations that it is made of, how many ended in another basin.
    """

    setting: Setting
    noise_draw: int
    T_reference_source: np.ndarray
    covariance: np.ndarray
    iterations: int = 0
    status: str = "ok"
    rmse: float = np.nan
    inlier_ratio: float = np.nan
    far: int = 0


def of_definite(status: str, covariance: np.ndarray) -> str:
    """The status of an estimate; `degenerate` if its covariance (6, 6) has no Cholesky factor."""
    try:
        np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        return "degenerate"
    return status if np.isfinite(covariance).all() else "degenerate"


def told(sigma: float) -> str:
    """A standard deviation [m] in words."""
    return f"{100 * sigma:g} cm"


@dataclass(frozen=True)
class Kind:
    """A kind of estimator; fields of a subclass are its options in the configuration.

    `name` is what `kind:` gives; `sees`: names of the causes that it can see, or None for all;
    `one_subsample`: whether all runs of a noise draw use one subsample of the source, that of the
    first of them; `defaults`: of the options of perturb.Perturbing that have another default for
    the kind; `foreign`: whether it registers with what is not ours, of which success is told first;
    `fewest_pairs`: how many pairs of other sequences the experiment that it learns from must have.
    """

    name: ClassVar[str]
    returns: ClassVar[Returns]
    sees: ClassVar[tuple[str, ...] | None] = None
    one_subsample: ClassVar[bool] = False
    defaults: ClassVar[dict] = {}
    foreign: ClassVar[bool] = False
    fewest_pairs: ClassVar[int] = 0

    @property
    def training(self) -> str | None:
        """Name of the experiment that it learns from; None if it does not."""
        return None

    @property
    def modules(self) -> tuple[ModuleType, ...]:
        """Modules of the user's own whose code makes its numbers besides that of the kind."""
        return ()

    @property
    def made_of(self) -> str:
        """What the covariance of a setting is made of, in a few words without an article."""
        parts = ["scatter of the samples"] * self.returns.samples
        return " and ".join(parts + ["covariances of its own"] * self.returns.covariances)

    @property
    def conflict(self) -> str:
        """What is wrong with its options together, after the name of one of them; "" if nothing."""
        return ""

    def number_of_runs(self, noise_draws: int) -> int:
        """How many starts a setting has; by default one for each noise draw."""
        return noise_draws

    def returned(self, noise_draws: int) -> Returns:
        """What comes back from so many noise draws: a `Returns`."""
        return self.returns

    def spread(self, noise_draws: int) -> str:
        """What the spread of a setting is made of, and what noise it was told: sentences."""
        return ""

    @property
    def drawn_sigma(self) -> float:
        """Standard deviation [m] of the sensor's own noise, drawn in every setting; 0 for none."""
        return 0.0

    @property
    def fewest_noise_draws(self) -> int:
        """The number of noise draws below which its options cannot be what they say."""
        return 1

    @property
    def neighbourhood(self) -> tuple[int, float] | None:
        """Nearest neighbours and radius [m] that give its normals; None where it has none."""
        return None

    def check_clean(self, runs: pd.DataFrame) -> None:
        """Raise UserError if the runs of a clean setting (rows of their table) say nothing."""

    def trained(self, table: pd.DataFrame, leave_out: str) -> Self:
        """The same after it has learned from a descriptors table, but for the sequence leave_out.

        Of kinds that have a `training`.
        """
        raise NotImplementedError

    def estimate(self, group: Group) -> Iterator[Samples | Covariance]:
        """Yields `Samples`, `Covariance` or both for every start of a perturb.Group."""
        raise NotImplementedError
