"""Explain one pair: measure, check, perturb, register, share out; the workflow's steps in a row."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from icpshap import estimators, plan
from icpshap.causes import CAUSES
from icpshap.causes.cause import SCANS
from icpshap.data.pair import Pair, describe_pair
from icpshap.data.scans import check_scan
from icpshap.errors import DataError, UserError
from icpshap.estimators.callable_registration import called, called_name
from icpshap.estimators.perturb import Draws, Streams, number_of_groups, require_points
from icpshap.explanation import games
from icpshap.explanation.scan_pair import ScanPair
from icpshap.fit import checks
from icpshap.fit.measure import measure
from icpshap.one_pair.explanation import Explanation, Scans
from icpshap.one_pair.given import SEED, given, named_pair, scan, times, transform, whole
from icpshap.one_pair.threads import cores, in_threads, one_by_one
from icpshap.report import what_if as what_if_tables
from icpshap.report.study import Study

if TYPE_CHECKING:
    from icpshap.one_pair.given import Given


PROBES = 3  # calls of a function, all of which must fail before it is refused
OWN_TRUTH = (
    "the true pose is what the registration itself answered: errors are relative to that answer, "
    "and a bias that it has on these scans is hidden"
)


def explain(
    reference: Any,
    source: Any,
    T: Any = None,
    *,
    causes: Mapping[str, float] | None = None,
    estimator: Any = "lidar",
    register: Callable | str | None = None,
    T_initial: Any = None,
    what_if: Mapping[str, Mapping[str, Any]] | bool = False,
    perturbation: Mapping[str, float] | None = None,
    source_times: Any = None,
    seed: int = SEED,
    name: str = "pair",
    indices: tuple[int, int] = (0, 1),
    threads: int | None = None,
    progress: bool | TextIO = False,
) -> Explanation:
    """Why the registration of two scans is uncertain: an `Explanation`.

    Args:
        reference: points (n, 3) [m] of the scan that is registered onto, in its scanner's frame.
        source: points (m, 3) [m] of the scan that is moved, in its own.
        T: the true T_reference_source, p_reference = T p_source: a matrix (4, 4) or (3, 4), its 16
            or 12 numbers row by row, or tx ty tz qx qy qz qw. None: ICP (or `register`) registers
            the scans from `T_initial`, and its answer is taken as the truth.
        causes: level of each cause that shares the uncertainty out, by name, at most seven; None:
            what a spinning scanner has, {"sensor_noise": 0.02, "initial_pose": 1.5,
            "partial_overlap": 0.05} (m, -, -).
        estimator: a preset ("lidar", "paper", "robust", "released_code"), a kind of estimator, a
            mapping of options, or a `Preset`. A mapping begins from `based_on`, one of these names;
            without it from the defaults of the `kind` that it names, which are those of "paper",
            and without either from "lidar".
        register: your own registration, a function (reference, source, T_initial) -> (4, 4), or
            its name as "module:function"; it is run as often as ICP would be, one at a time, and
            once before on the scans as they are. Options of the estimator that it does not take
            are left out of a preset, and an error where they are named.
        T_initial: without T, where the registration that answers for it starts, in the same forms;
            None: the identity.
        what_if: changes by name, each a mapping of options or levels, with which the pair is
            explained again; True: more neighbours, a tighter stop, more points, a closer start.
        perturbation: what the causes refer to, where it is not the paper's: initial_pose_rotation
            [deg], initial_pose_translation [m], overlap_distance [m], minimum_overlap [-].
        source_times: when each source point was measured (m,), for the cause motion_distortion,
            which must be one of `causes`.
        seed: of all random numbers; same seed, scans and options, same bytes.
        name: the sequence that random numbers are drawn for.
        indices: its two scans; with the name of a workflow's sequence they give its numbers, to the
            byte.
        threads: how many at once, which changes no byte; None: all cores.
        progress: True prints a line to standard error, or a file to print to.

    Raises:
        UserError: an argument cannot be used, or says what is wrong with the scans.

    >>> import numpy as np
    >>> import icpshap
    >>> random = np.random.default_rng(0)
    >>> reference, source = random.uniform(-2, 4, (2, 3000, 3))  # of three walls that meet
    >>> for points in (reference, source):
    ...     points[range(3000), random.integers(3, size=3000)] = -2
    >>> few = {"based_on": "paper", "runs": 50, "subsampling_probability": 0.5}
    >>> explanation = icpshap.explain(
    ...     reference, source, np.eye(4), causes={"sensor_noise": 0.05}, estimator=few
    ... )
    >>> bool(explanation.shapley.value["sensor_noise"] > 1)  # [nats]
    True
    >>> explanation.covariance.order
    'rotation first'
    """
    reference, source = scan(reference, "reference"), scan(source, "source")
    source_times = times(source_times, len(source))
    asked = given(causes, estimator, register, what_if, perturbation, seed)
    if source_times is not None and "motion_distortion" not in asked.levels:
        raise UserError(
            "source_times: given, and motion_distortion, which alone reads them, is no cause.\n"
            'Hint: causes={..., "motion_distortion": 0.05}, or leave source_times out.'
        )
    streams = Streams(asked.seed, *named_pair(name, indices))
    threads = cores() if threads is None else whole(threads, "threads", 1)
    parts: list[Any] = [(what_if_tables.AS_IT_IS, {}, asked.levels, asked.preset)]
    parts += [(change, *changed) for change, changed in asked.what_if.items()]
    said = _Progress(progress, len(parts))
    with threadpool_limits(1):  # the order of sums must not depend on the cores
        pair, truth = pair_of(reference, source, T, T_initial, asked, source_times)
        runs = [
            _Run(pair, preset, levels, asked.perturbation, streams, truth, said)
            for _, _, levels, preset in parts
        ]
        made = []
        try:
            for (part, *_), run in zip(parts, runs, strict=True):
                said.begin(part)
                made.append(run.made(threads))
        finally:
            said.end()
    tables = made[0]
    if asked.what_if:
        rows = [
            (part, changes, found["shap"])
            for (part, changes, *_), found in zip(parts, made, strict=True)
        ]
        tables["what_if"] = what_if_tables.table(rows, tables["pairs"])
    study = Study.of(
        asked.name,
        asked.name,
        asked.preset,
        asked.levels,
        titles={name: name},
        waterfall=asked.levels,
    )
    study = replace(study, options=_told(study.options))
    return Explanation(
        tables,
        study,
        _told(asked.preset.options),
        asked.levels,
        asked.seed,
        truth,
        _shares_of_points(asked.preset, asked.levels),
        runs[0].scans(),
    )


def fit_table(
    reference: Any,
    source: Any,
    T: Any = None,
    *,
    causes: Mapping[str, float] | None = None,
    estimator: Any = "lidar",
    register: Callable | str | None = None,
    T_initial: Any = None,
    perturbation: Mapping[str, float] | None = None,
    seed: int = SEED,
) -> pd.DataFrame:
    """Whether an estimator's options fit two scans, before any of its runs: the fit table.

    Arguments and errors as of `explain`; `register` is called once, on the scans as they are. A row
    a check: check, value, unit, expected, grade (red, remark, fits), sentence, remedy; the gravest
    first.

    >>> import numpy as np
    >>> import icpshap
    >>> random = np.random.default_rng(0)
    >>> reference, source = random.uniform(-2, 4, (2, 3000, 3))  # of three walls that meet
    >>> for points in (reference, source):
    ...     points[range(3000), random.integers(3, size=3000)] = -2
    >>> found = icpshap.fit_table(reference, source, np.eye(4))
    >>> found.grade[found.check == "overlap"].item()
    'fits'
    """
    reference, source = scan(reference, "reference"), scan(source, "source")
    asked = given(causes, estimator, register, None, perturbation, seed)
    with threadpool_limits(1):
        pair, truth = pair_of(reference, source, T, T_initial, asked)
        streams = Streams(asked.seed, "pair", 0, 1)
        run = _Run(pair, asked.preset, asked.levels, asked.perturbation, streams, truth, None)
        return checks.graver_first(checks.table(run.fit_numbers())).reset_index(drop=True)


def pair_of(
    reference: np.ndarray,
    source: np.ndarray,
    T: np.ndarray | None,
    T_initial: np.ndarray | None,
    asked: Given,
    source_times: np.ndarray | None = None,
) -> tuple[Pair, str]:
    """The measured pair of scans (n, 3), (m, 3) [m], and what is to be said of its true pose."""
    minimum_range = asked.preset.estimator.perturbing.minimum_range
    for points, what in ((reference, "reference"), (source, "source")):
        check_scan(points, minimum_range, what)
    T, truth = _truth(reference, source, T, T_initial, asked.preset)
    distance = asked.perturbation.overlap_distance
    pair = Pair.measured(reference, source, T, distance, source_times)
    return pair.for_chain(minimum_range), truth


def _truth(reference, source, T, T_initial, preset):
    """The true pose, and what is to be said of how it was found ("" of a given one)."""
    if T is not None and T_initial is not None:
        raise UserError(
            "T_initial: given with T, expected one of them: it is where the registration starts "
            "that answers for T.\nHint: leave out T_initial."
        )
    argument = "T_initial" if T is None else "T"
    start = transform(T, "T") if T is not None else np.eye(4)
    start = start if T_initial is None else transform(T_initial, "T_initial")
    kind = preset.estimator.kind
    if kind.foreign:
        answer = _registered(kind.function(), reference, source, start, argument)
    elif T is None:
        from icpshap.data import registering  # the engine is loaded where it runs

        found = registering.register_scans(reference, source, start, "the two scans", argument)
        answer = found.T_reference_source
    return (answer, OWN_TRUTH) if T is None else (start, "")


def _registered(function, reference, source, T_initial, argument):
    """What a user's function answers for the two scans: one that never does is found out at once.

    argument: name of the one that says where it starts. Raises DataError.
    """
    for _ in range(PROBES):
        end = called(function, reference, source, T_initial)
        if end.status == "ok":
            return end.T_reference_source
    raise DataError(
        f"register: called with the scans and {argument}, {called_name(function)} {end.status}.",
        "it must return the rigid transformation (4, 4) from the source's frame to the "
        f"reference's; if it does so elsewhere, {argument} may be far from the answer.",
    ) from end.error


def _told(options):
    """Options as a file can hold them: a function by its name."""
    return {key: called_name(value) if callable(value) else value for key, value in options.items()}


def _shares_of_points(preset, levels):
    """What share of the source's points that the chain's filters leave a run uses.

    Of a clean run, and of one with all causes on.
    """
    probability = preset.estimator.perturbing.subsampling_probability
    return probability, probability / levels.get("icp_randomness", 1.0)


class _Run:
    """One explanation of a pair: `levels` with a preset."""

    def __init__(self, pair, preset, levels, perturbation, streams, truth, said):
        self.pair, self.preset, self.levels = pair, preset, levels
        self.estimator = preset.estimator.of_causes(levels)
        self.perturbation, self.streams, self.truth, self.said = perturbation, streams, truth, said

    def fit_numbers(self):
        """The fit_numbers table."""
        numbers = measure(self.pair, self.estimator, self.levels, self.streams)
        return pd.DataFrame([{**self._named, **numbers}])

    @property
    def _named(self):
        streams = self.streams
        return {
            "sequence": streams.sequence,
            "reference": streams.reference,
            "source": streams.source,
        }

    def made(self, threads):
        """What comes of it, with so many threads: tables by name."""
        row = self._describe()
        numbers = self.fit_numbers()
        settings = plan.settings({name: (level,) for name, level in self.levels.items()}, 1)
        self.said.of(number_of_groups(settings, self.estimator))
        step = self.said.step
        runs, estimates = estimators.estimate(
            self.pair,
            settings,
            self.estimator,
            self.perturbation.deviation,
            self.streams,
            one_by_one(step) if self.estimator.kind.foreign else in_threads(threads, step),
        )
        off = {name: CAUSES[name].off for name in self.levels}
        instances = pd.DataFrame([{"instance": 0, **self.levels}])
        pairs = pd.DataFrame([row])
        scan_pair = ScanPair.of(next(pairs.itertuples()))
        read_by = (off, self.estimator.returned, self.preset.method)
        explained = games.explain(runs, estimates, instances, *read_by, scan_pair)._asdict()
        fit = checks.complete(numbers, explained["uncertainty"], off)
        explained["shap"] = checks.marked(explained["shap"], fit)
        found = {"pairs": pairs, "fit": fit, "fit_numbers": numbers, **explained}
        where = {"reference": self.streams.reference, "source": self.streams.source}
        for name, table in (("runs", runs), ("estimates", estimates)):
            if table is not None:
                found[name] = table.assign(**where).reset_index(drop=True)
        return found

    def scans(self):
        """The scans, and which of their points are left."""
        draws = Draws(self.pair, self.estimator, self.perturbation.deviation, self.streams)
        setting = plan.Setting.at(self.levels)
        return Scans(self.pair, *(draws.left(setting, scan, 0) for scan in SCANS))

    def _describe(self):
        """The row of the pairs table. Raises DataError for a pair that cannot be registered."""
        row = describe_pair(
            self.pair,
            self.streams.sequence,
            (self.streams.reference, self.streams.source),
            levels=[(self.estimator.causes[name], level) for name, level in self.levels.items()],
            minimum_overlap=self.perturbation.minimum_overlap,
            minimum_range=self.estimator.perturbing.minimum_range,
            truth=self.truth,
        )
        if not row["registered"]:
            raise DataError(
                f"the scans are not registered: {row['reason']}.",
                "check T, its direction (it maps source to reference) and the units; or lower "
                "perturbation's minimum_overlap.",
            )
        if any(cause.counts_points for cause in self.estimator.causes.values()):
            largest = plan.Setting.at(self.levels)
            require_points(self.pair, largest, self.estimator, self.streams)
        return row


class _Progress:
    """A line that says how far it is: told at the beginning and the end, and every step between."""

    def __init__(self, progress, parts):
        self.file = sys.stderr if progress is True else progress or None
        self.parts, self.part, self.name, self.width = parts, 0, "", 0
        self.steps, self.number = 0, None
        try:
            self._print("")
        except (AttributeError, TypeError, ValueError) as error:
            raise UserError(
                f"progress: {progress!r} cannot be printed to ({error}), expected True, False or "
                "an open text file.\nHint: progress=True prints to standard error."
            ) from None

    def begin(self, name):
        self.part, self.name = self.part + 1, name
        self.steps, self.number = 0, None
        self._show()

    def of(self, number):
        """How many steps there will be of what has begun."""
        self.number = number
        self._show()

    def step(self):
        self.steps += 1
        self._show()

    def end(self):
        if self.part:
            self._print("\n")

    def _show(self):
        steps = "" if self.number is None else f": step {self.steps} of {self.number}"
        text = f"{self.name} ({self.part} of {self.parts}){steps}"
        self.width = max(self.width, len(text))  # what is longer must not show through
        self._print(f"\r{text:<{self.width}}")

    def _print(self, text):
        if self.file is not None:
            print(text, end="", file=self.file, flush=True)
