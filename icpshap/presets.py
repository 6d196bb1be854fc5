"""An estimator together with how its estimates are read, and the four that are known by name."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from icpshap import options
from icpshap.estimators import KINDS, Estimator, option_owners
from icpshap.explanation.method import Method

DEFAULT_KIND = "monte_carlo"


@dataclass(frozen=True)
class Preset:
    """From a perturbed pair to an uncertainty: an `Estimator`, and the `Method` that reads it."""

    estimator: Estimator
    method: Method

    @classmethod
    def of(cls, kind: str = DEFAULT_KIND, **values: Any) -> Preset:
        """The preset of a kind's name with these options; others keep their default.

        Raises TypeError for an option that the kind does not have.
        """
        if unknown := set(values) - set(option_names(kind)):
            raise TypeError(f"{', '.join(sorted(unknown))}: no options of the kind {kind}.")
        of_method = {name: values[name] for name in options.names(Method) if name in values}
        return cls(Estimator.of(kind, values), Method(**of_method))

    @property
    def options(self) -> dict[str, Any]:
        """All options by name, with the kind."""
        estimator = self.estimator
        owners = (estimator.kind, estimator.perturbing, *estimator.causes.values(), self.method)
        values = {name: value for owner in owners for name, value in options.values(owner).items()}
        return {"kind": estimator.kind.name, **values}

    def with_options(self, **values: Any) -> Preset:
        """The same with some options changed.

        >>> PAPER.with_options(runs=200).options["runs"]
        200
        """
        return Preset.of(**{**self.options, **values})


def owners(kind: str) -> list[type]:
    """The classes whose options the configuration of a kind of estimator has."""
    return [*option_owners(kind), Method]


def option_names(kind: str) -> list[str]:
    """Names of the options of a kind of estimator."""
    return [name for owner in owners(kind) for name in options.names(owner)]


def required(kind: str) -> list[str]:
    """Names of the options that an estimator of a kind must be given."""
    return [name for owner in owners(kind) for name in options.without_default(owner)]


def kinds_with(name: str) -> list[str]:
    """The kinds of estimators that have an option of this name."""
    return [kind for kind in KINDS if name in option_names(kind)]


PAPER = Preset.of()
"""The paper's text and, where that is silent, the authors' released code: every default."""

RELEASED_CODE = PAPER.with_options(
    subsampling_mask="frozen_in_order",
    initial_pose_scaling="standard_deviation",
    initial_pose_composition="left_inverse",
    reference_noise_additions=2,
    overlap_removal="noisy",
)
"""The authors' released code, where it differs from the paper."""

ROBUST = PAPER.with_options(
    stop_rotation=1e-5,
    stop_translation=1e-5,
    noise_draws=10,
    sensor_sigma=0.01,
    bias_correction="jackknife",
    wrong_basins="leave_out",
)
"""What we would publish."""

LIDAR = ROBUST.with_options(
    voxel_size=0.25,
    normal_neighbours=20,
    subsampling_probability=0.5,
    stop_rotation=1e-4,
    stop_translation=1e-4,
)
"""`robust` for your own scans, those of spinning scanners above all (docs/own_scans.md).

The seven points next to one lie on its ring there, and have no normal; twenty on a grid have one.
Half of its points is what a run sees: the spread over halves is about that of the whole. A step of
0.1 mm is far below that spread, and a tighter stop changes no number that is shown.
"""
