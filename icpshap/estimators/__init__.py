"""Estimators: from a perturbed pair to pose samples, covariances, or both.

`perturb` makes groups of settings, a `kind` consumes them; here they meet, and become tables.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from icpshap import options, registry, se3
from icpshap.causes import CAUSES, named
from icpshap.causes.cause import Cause
from icpshap.errors import PerturbationError
from icpshap.estimators import perturb
from icpshap.estimators.kind import Kind, Samples
from icpshap.estimators.perturb import Perturbing
from icpshap.tables import INITIAL_XI, TRANSFORM, XI, covariance_columns

if TYPE_CHECKING:
    from icpshap.data.pair import Pair
    from icpshap.estimators.kind import Returns
    from icpshap.plan import Setting


KINDS = registry.classes(__name__, __path__, Kind)


@dataclass(frozen=True)
class Estimator:
    """A kind, how the pair is perturbed for it, and every cause: all with their options."""

    kind: Kind
    perturbing: Perturbing
    causes: dict[str, Cause]

    @classmethod
    def of(cls, kind: str, values: Mapping[str, Any]) -> Estimator:
        """The estimator of a kind's name and a mapping of options; others keep their default."""

        def built(owner):
            return owner(**{name: values[name] for name in options.names(owner) if name in values})

        values = {**KINDS[kind].defaults, **values}
        causes = {cause.name: built(cause) for cause in named(CAUSES)}
        return cls(built(KINDS[kind]), built(Perturbing), causes)._with_own_noise()

    @classmethod
    def decided(cls, by: Mapping[str, Any]) -> Estimator:
        """The estimator of what `decides` returned."""
        return cls(
            KINDS[by["kind"]](**by["options"]),
            Perturbing(**by["perturbing"]),
            {name: CAUSES[name](**values) for name, values in by["causes"].items()},
        )._with_own_noise()

    def _with_own_noise(self):
        """The same with the sensor's own noise in every setting, if the kind wants it drawn."""
        if not (sigma := self.kind.drawn_sigma):
            return self
        causes = {name: cause.with_own_noise(sigma) for name, cause in self.causes.items()}
        return replace(self, causes=causes)

    def trained(self, table: pd.DataFrame, leave_out: str) -> Estimator:
        """The same with a kind that has learned from a descriptors table, but for one sequence."""
        return replace(self, kind=self.kind.trained(table, leave_out))

    @property
    def returned(self) -> Returns:
        """What comes back of a setting: `kind.Returns`."""
        found = self.kind.returned(self.perturbing.noise_draws)
        if all(cause.adds_evenly for cause in self.causes.values()):
            return found
        return replace(found, sensor_sigma=0.0)

    @property
    def number_of_runs(self) -> int:
        """Starts of a setting."""
        return self.kind.number_of_runs(self.perturbing.noise_draws)

    def of_causes(self, names: Collection[str]) -> Estimator:
        """The same with the causes that an experiment names, and those that act without that."""
        return Estimator(
            self.kind,
            self.perturbing,
            {
                name: cause
                for name, cause in self.causes.items()
                if name in names or cause.acts_when_off
            },
        )

    @property
    def plugins(self) -> list[type | ModuleType]:
        """The classes and the modules of the user's own whose code makes its numbers."""
        causes = (type(cause) for cause in self.causes.values())
        return [type(self.kind), *self.kind.modules, *causes]

    def decides(self) -> dict[str, Any]:
        """All that decides its numbers, as a mapping that JSON can hold; see `decided`."""
        return {
            "kind": self.kind.name,
            "options": options.deciding(self.kind),
            "perturbing": options.values(self.perturbing),
            "causes": {name: options.deciding(cause) for name, cause in self.causes.items()},
        }


def option_owners(kind: str) -> list[type]:
    """The classes whose options an estimator of a kind takes."""
    return [KINDS[kind], Perturbing, *CAUSES.values()]


def estimate(
    pair: Pair,
    settings: list[Setting],
    estimator: Estimator,
    deviation: np.ndarray,
    streams: perturb.Streams,
    mapped: Callable[..., Iterable] = map,
) -> tuple[pd.DataFrame | None, pd.DataFrame | None]:
    """The tables of runs and of estimates of a pair, each in the order of the settings.

    pair: data.pair.Pair; settings: list of plan.Setting; deviation (6,): standard deviation of the
    initial pose at scale 1; streams: perturb.Streams of the pair; mapped: calls a function for each
    group of settings, as `map` does, or in several threads. A table that the estimator does not
    return is None. Raises PerturbationError if a setting cannot be applied to the pair,
    UserError if the clean runs say nothing, TypeError if the estimator does not return what it
    says.
    """
    runs, estimates = defaultdict(list), defaultdict(list)
    groups = perturb.groups(pair, settings, estimator, deviation, streams)
    groups = _with_enough_points(groups, estimator, streams)
    for of_group in mapped(lambda group: list(estimator.kind.estimate(group)), groups):
        for returned in of_group:
            if isinstance(returned, Samples):
                runs[returned.setting].append(_runs_columns(pair, returned))
            else:
                estimates[returned.setting].append(_estimates_columns(pair, returned))
    _check_returned(estimator, runs, estimates)
    for setting in runs:
        if all(setting.level(cause) == cause.off for cause in estimator.causes.values()):
            estimator.kind.check_clean(_table(runs, [setting]))
    return _table(runs, settings), _table(estimates, settings)


def _with_enough_points(groups, estimator, streams):
    """The groups. Raises PerturbationError where a reference has too few points to register on."""
    neighbours, _ = estimator.kind.neighbourhood or (0, 0.0)
    fewest = max(perturb.FEWEST_POINTS, neighbours)
    for group in groups:
        if len(group.reference) < fewest:
            raise PerturbationError(
                f"{streams.sequence}, scans {streams.reference} and {streams.source}: filters and "
                f"causes leave {len(group.reference)} points of the reference, expected at least "
                f"{fewest}.\nHint: a smaller voxel_size or minimum_range, or fewer neighbours of a "
                "normal."
            )
        yield group


def _check_returned(estimator, runs, estimates):
    """Raise TypeError unless an estimator returned what its kind says."""
    said = (estimator.returned.samples, estimator.returned.covariances)
    if (bool(runs), bool(estimates)) != said:
        words = {
            (True, False): "samples alone",
            (False, True): "covariances alone",
            (True, True): "samples and covariances",
            (False, False): "nothing",
        }
        raise TypeError(
            f"The kind {estimator.kind.name} returned {words[bool(runs), bool(estimates)]}, and "
            f"its `returns` says {words[said]}.\n"
            "Hint: yield Samples, Covariance or both for every start."
        )


def _table(columns, settings):
    """One table of the columns returned for each setting, in the order of the settings."""
    if not columns:
        return None
    parts = [part for setting in settings for part in columns[setting]]
    return pd.DataFrame({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def _runs_columns(pair, samples):
    return _columns(
        len(samples.runs),
        **_setting_columns(samples.setting),
        run=samples.runs.astype(np.int32),
        noise_draw=np.int32(samples.noise_draw),
        weight=samples.weight,
        **dict(zip(INITIAL_XI, samples.initial_xi.T, strict=True)),
        **_pose_columns(pair, samples.T_reference_source),
        iterations=samples.iterations.astype(np.int32),
        status=samples.status,
        rmse=samples.rmse,
        inlier_ratio=samples.inlier_ratio,
    )


def _estimates_columns(pair, estimate):
    return _columns(
        1,
        **_setting_columns(estimate.setting),
        noise_draw=np.int32(estimate.noise_draw),
        **_pose_columns(pair, estimate.T_reference_source[None]),
        **covariance_columns(estimate.covariance),
        iterations=np.int32(estimate.iterations),
        status=estimate.status,
        rmse=estimate.rmse,
        inlier_ratio=estimate.inlier_ratio,
        n_far=np.int32(estimate.far),
    )


def _columns(length, **values):
    """Arrays of that length, out of such and single values."""
    return {name: np.broadcast_to(value, length) for name, value in values.items()}


def _setting_columns(setting):
    return {
        **setting.values,
        "replicate": np.int32(setting.replicate),
        "again": setting.again,
    }


def _pose_columns(pair, T_reference_source):
    """Pose error log(inv(T_gt) T) and transform of poses (k, 4, 4)."""
    error = se3.log(se3.inverse(pair.T_reference_source) @ T_reference_source)
    return {
        **dict(zip(XI, error.T, strict=True)),
        **dict(zip(TRANSFORM, T_reference_source.reshape(-1, 16).T, strict=True)),
    }
