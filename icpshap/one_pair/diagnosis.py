"""Diagnose one pair of scans: what is wrong with it, without perturbing or explaining it."""

import json
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from icpshap import estimators
from icpshap.causes import CAUSES
from icpshap.causes._sensors import ACCURACY, SENSORS
from icpshap.diagnosis.diagnose import Known, diagnose_alone
from icpshap.diagnosis.diagnose import diagnose as diagnose_against
from icpshap.diagnosis.table import row
from icpshap.errors import DataError, UserError
from icpshap.estimators.perturb import Streams
from icpshap.explanation.sample import samples
from icpshap.explanation.shares import wrong_basin_shares
from icpshap.one_pair.explanation import plain
from icpshap.one_pair.given import SEED, given, named_pair, scan
from icpshap.one_pair.recipe import pair_of
from icpshap.plan import Setting
from icpshap.report import diagnosis as told

OWN_POSE = (
    "The pose is what the registration itself answered: where it is wrong by more than the overlap "
    "distance, overlap and weakest direction are too."
)


class CleanRuns(NamedTuple):
    """Where runs of the pair end that nothing perturbs.

    wrong_basin_share [-]: of those that failed or ended in a wrong basin, with the ends of its
    interval; NaN where fewer than half of the runs lie together.
    """

    number: int
    wrong_basin_share: float
    low: float
    high: float

    @property
    def sentence(self) -> str:
        if np.isnan(self.wrong_basin_share):
            return f"Fewer than half of {self.number} clean runs lie together."
        return (
            f"Of {self.number} clean runs {self.wrong_basin_share:.0%} [{self.low:.0%}, "
            f"{self.high:.0%}] failed or ended in a wrong basin."
        )


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """What is wrong with a pair; table: the row of the workflow's table `diagnosis`.

    truth: what is to be said of how the pose was found, "" of a given one; sheet: of the data sheet
    that the pair is held against, "" of none; clean_runs: None where none were asked for.
    """

    table: pd.DataFrame
    truth: str
    sheet: str
    clean_runs: CleanRuns | None = None

    @property
    def sentence(self) -> str:
        """The verdict."""
        return told.sentence(next(self.table.itertuples()))

    @property
    def causes(self) -> list[str]:
        """The names of the causes that were found, or that cannot be told apart."""
        names = self.table.causes.iloc[0]
        return names.split(", ") if names else []

    @property
    def levels(self) -> dict[str, float]:
        """Level by name of each cause that scans show, in its own unit; 0 of those not found.

        NaN of those that there is nothing to hold against.
        """
        prefix = "level_"
        found = self.table.iloc[0]
        return {
            name.removeprefix(prefix): float(found[name])
            for name in self.table.columns
            if name.startswith(prefix)
        }

    def to_text(self, width: int = 100) -> str:
        """A screen."""
        of_pair = next(self.table.itertuples())
        numbers = (
            f"Plane residual {1000 * of_pair.plane_residual:.1f} mm, overlap {of_pair.overlap:.2f}."
        )
        ends = self.clean_runs.sentence if self.clean_runs else ""
        doubts = [told.doubts(of_pair), self.sheet, told.unseen(), self.truth]
        lines = [self.sentence, numbers, told.weakest(of_pair), ends, *doubts]
        return "\n".join(textwrap.fill(line, width) for line in lines if line)

    def to_dict(self) -> dict[str, Any]:
        """All of it, as JSON can hold it; None for no value."""
        values = plain(self.table.iloc[0].to_dict())
        runs = plain(self.clean_runs._asdict()) if self.clean_runs else None
        said = {"truth": self.truth, "sheet": self.sheet}
        return {"sentence": self.sentence, **values, "clean_runs": runs, **said}

    def to_json(self) -> str:
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def __repr__(self) -> str:
        return self.sentence


def diagnose(
    reference: Any,
    source: Any,
    T: Any = None,
    *,
    healthy: Sequence[Sequence[Any]] = (),
    sensor: str | None = None,
    clean_runs: bool = False,
    estimator: Any = "lidar",
    T_initial: Any = None,
    seed: int = SEED,
    name: str = "pair",
    indices: tuple[int, int] = (0, 1),
) -> Diagnosis:
    """What is wrong with two scans, beside healthy ones: a `Diagnosis`.

    Args:
        reference: points (n, 3) [m], as of `explain`.
        source: points (m, 3) [m], as of `explain`.
        T: the true T_reference_source, as of `explain`.
        healthy: pairs of the same scanner in the same kind of place, each (reference, source) or
            (reference, source, T), such as the drive's other pairs; some may be unusual. From one
            on they say what is usual; eight say how much that varies.
        sensor: name of a scanner whose published noise is taken where there are no healthy pairs.
        clean_runs: whether ICP is run as well, without any perturbation, to see how often it ends
            in a wrong basin: the estimator's `runs`, of its seconds.
        estimator: its minimum range counts, that of its registration where T is not given, and all
            of it in clean runs.
        T_initial: where the registration starts if T is not given, as of `explain`.
        seed: of all random numbers.
        name: the sequence that random numbers are drawn for.
        indices: its two scans.

    Raises:
        UserError: an argument cannot be used, or says what is wrong with the scans.

    >>> import numpy as np
    >>> import icpshap
    >>> random = np.random.default_rng(0)
    >>> reference, source = random.uniform(-2, 4, (2, 3000, 3))  # of three walls that meet
    >>> for points in (reference, source):
    ...     points[range(3000), random.integers(3, size=3000)] = -2
    ...     points += random.normal(scale=0.2, size=(3000, 3))
    >>> found = icpshap.diagnose(reference, source, np.eye(4), sensor="hokuyo_utm_30lx")
    >>> round(found.levels["sensor_noise"], 1)  # [m]
    0.2
    """
    if sensor is not None and sensor not in SENSORS:
        raise UserError(
            f"sensor: {sensor!r}, expected one of {', '.join(SENSORS)}.\n"
            "Hint: docs/causes.md has what is published of each."
        )
    healthy = _listed(healthy)
    if sensor is not None and len(healthy):
        raise UserError(
            "sensor: given with healthy pairs, which say more.\nHint: leave one of them out."
        )
    asked = given(None, estimator, None, None, None, seed)
    if clean_runs and not asked.preset.estimator.returned.samples:
        raise UserError(
            f"clean_runs: the kind {asked.preset.estimator.kind.name} returns no pose samples, and "
            "so nothing that ends anywhere.\nHint: estimator: lidar, or no clean_runs."
        )
    key, own_reference, own_source = named_pair(name, indices)
    # Only the pair that is diagnosed may start elsewhere than the identity.
    named = [("", (reference, source, T), T_initial)]
    named += [(f"healthy {place}: ", _three(of, place), None) for place, of in enumerate(healthy)]
    streams = [Streams(asked.seed, key, own_reference, own_source)]
    streams += [
        Streams(asked.seed, f"{key} healthy", place, place + 1) for place in range(len(healthy))
    ]
    with threadpool_limits(1):  # the order of sums must not depend on the cores
        known = []
        own: list[Any] = []
        for of_pair, (word, (first, second, pose), start) in zip(streams, named, strict=True):
            clouds = scan(first, f"{word}reference"), scan(second, f"{word}source")
            if own and all(map(np.array_equal, clouds, own)):
                raise UserError(
                    f"{word}the pair that is diagnosed, expected another one.\n"
                    "Hint: beside itself no pair is unusual; leave it out."
                )
            own = own or list(clouds)
            pair, truth = pair_of(*clouds, pose, start, asked)
            minimum_range = asked.preset.estimator.perturbing.minimum_range
            measured = Known(partial(pair.for_chain, minimum_range), of_pair)
            if not measured.diagnostics.are_known:
                raise DataError(
                    f"{word or 'the pair: '}an overlap of {measured.diagnostics.overlap:.3f} at "
                    f"the pose, or no planes beyond {minimum_range:g} m: nothing can be measured.",
                    "check the pose, its direction (it maps source to reference) and the units.",
                )
            known.append((measured, OWN_POSE if truth else ""))
        (one, truth), *others = known
        if others:
            found = diagnose_against(one, [other for other, _ in others])
            healthiest = found.healthiest
            beside = None if healthiest is None else streams[1 + healthiest]
            of_row = row(found, streams[0], beside)
        else:
            of_row = row(diagnose_alone(one, sensor), streams[0], None)
        ends = None
        if clean_runs:
            ends = _clean_runs(one.load(), asked, streams[0])
    return Diagnosis(pd.DataFrame([of_row]), truth, _of_sheet(sensor), ends)


def _clean_runs(pair, asked, streams):
    """The `CleanRuns` of a data.pair.Pair: those that `explain` has."""
    estimator, off = asked.preset.estimator, {name: CAUSES[name].off for name in asked.levels}
    estimator = estimator.of_causes(off)
    runs, estimates = estimators.estimate(
        pair, [Setting.at(off)], estimator, asked.perturbation.deviation, streams
    )
    given_ = (off, estimator.returned, asked.preset.method, pair.characteristic_length)
    (sample,) = samples(runs, estimates, *given_)
    return CleanRuns(sample.xi.shape[1], *map(float, wrong_basin_shares(sample)[:, 0]))


def _of_sheet(name):
    """What is to be said of what a scanner's sheet says, "" of a standard deviation."""
    if name is None or SENSORS[name].says != ACCURACY:
        return ""
    return (
        f"Of the {SENSORS[name].title} an accuracy is published, which is no standard deviation: "
        "noise below it may be unusual all the same."
    )


def _listed(healthy):
    """Healthy pairs as they are given. Raises UserError for what is no list of pairs."""
    if not isinstance(healthy, Sequence) or isinstance(healthy, str):
        raise UserError(
            f"healthy: {type(healthy).__name__}, expected a list of pairs, each (reference, source)"
            " or (reference, source, T).\nHint: a list of pairs, even of one; [] of none."
        )
    return healthy


def _three(pair, place):
    """Reference, source and T of a healthy pair. Raises UserError."""
    parts = len(pair) if isinstance(pair, Sequence) and not isinstance(pair, str) else None
    if parts not in (2, 3):
        raise UserError(
            f"healthy: entry {place} {f'has {parts} parts' if parts else 'is no pair'}, expected "
            "(reference, source) or (reference, source, T).\nHint: a list of pairs, even of one."
        )
    return (*pair, None)[:3]
