"""Explain one pair: measure, check, perturb, register, share out; the workflow's steps in a row."""

import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TextIO

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from icpshap import estimators, plan
from icpshap.causes import CAUSES
from icpshap.causes.cause import SCANS
from icpshap.data.pair import Pair, describe_pair
from icpshap.errors import DataError
from icpshap.estimators.perturb import Draws, Streams, require_points
from icpshap.explanation import games
from icpshap.explanation.sample import samples
from icpshap.explanation.scan_pair import ScanPair
from icpshap.explanation.shapley import coalition_values
from icpshap.explanation.uncertainty import covariances
from icpshap.fit import checks
from icpshap.fit.measure import measure
from icpshap.one_pair.explanation import Explanation, Scans
from icpshap.one_pair.given import given, scan, times, transform
from icpshap.one_pair.threads import cores, in_threads
from icpshap.report import what_if as what_if_tables
from icpshap.report.study import Study

SEED = 42  # that of config.yaml
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
            mapping of options (`based_on` one of these; "lidar" unless said), or a `Preset`.
        register: your own registration, a function (reference, source, T_initial) -> (4, 4), or
            its name as "module:function"; it is run as often as ICP would be, one at a time.
        T_initial: where the registration that answers for the truth starts; None: the identity.
        what_if: changes by name, each a mapping of options or levels, with which the pair is
            explained again; True: more neighbours, a tighter stop, more points, a closer start.
        perturbation: what the causes refer to, where it is not the paper's: initial_pose_rotation
            [deg], initial_pose_translation [m], overlap_distance [m], minimum_overlap [-].
        source_times: when each source point was measured (m,), for motion distortion.
        seed: of all random numbers; same seed, scans and options, same bytes.
        name, indices: the sequence and the scans that random numbers are drawn for: those of a
            workflow's pair give its numbers, to the byte.
        threads: how many at once, which changes no byte; None: all cores.
        progress: True prints a line to standard error, or a file to print to.

    Raises:
        UserError: an argument cannot be used, or says what is wrong with the scans.
    """
    reference, source = scan(reference, "reference"), scan(source, "source")
    source_times = times(source_times, len(source))
    asked = given(causes, estimator, register, what_if, perturbation)
    streams = Streams(seed, name, *indices)
    with threadpool_limits(1):  # the order of sums must not depend on the cores
        T, truth = _truth(reference, source, T, T_initial, asked.preset)
        pair = Pair.measured(
            reference, source, T, asked.perturbation.overlap_distance, source_times
        )
        parts: list[Any] = [(what_if_tables.AS_IT_IS, {}, asked.levels, asked.preset)]
        parts += [(name, *changed) for name, changed in asked.what_if.items()]
        said = _Progress(progress, len(parts))
        made = []
        for part, _, levels, preset in parts:
            said.begin(part)
            run = _Run(pair, preset, levels, asked.perturbation, streams, truth, said)
            made.append(run.made(threads or cores()))
        said.end()
    tables = made[0].tables
    if asked.what_if:
        rows = [
            (part, changes, found.tables["shap"])
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
    options = {key: value for key, value in asked.preset.options.items() if not callable(value)}
    return Explanation(
        tables,
        made[0].covariances,
        study,
        options,
        asked.levels,
        seed,
        truth,
        _share_of_points(asked.preset, asked.levels),
        made[0].scans,
    )


def fit_table(
    reference: Any,
    source: Any,
    T: Any = None,
    *,
    causes: Mapping[str, float] | None = None,
    estimator: Any = "lidar",
    T_initial: Any = None,
    perturbation: Mapping[str, float] | None = None,
    seed: int = SEED,
) -> pd.DataFrame:
    """Whether an estimator's options fit two scans, before any of its runs: the fit table.

    Arguments and errors as of `explain`. A row a check: check, value, unit, expected, grade (red,
    remark, fits), sentence, remedy; the gravest first.
    """
    reference, source = scan(reference, "reference"), scan(source, "source")
    asked = given(causes, estimator, None, None, perturbation)
    with threadpool_limits(1):
        T, truth = _truth(reference, source, T, T_initial, asked.preset)
        pair = Pair.measured(reference, source, T, asked.perturbation.overlap_distance)
        streams = Streams(seed, "pair", 0, 1)
        run = _Run(pair, asked.preset, asked.levels, asked.perturbation, streams, truth, None)
        return checks.graver_first(checks.table(run.fit_numbers())).reset_index(drop=True)


def _truth(reference, source, T, T_initial, preset):
    """The true pose, and what is to be said of how it was found ("" of a given one)."""
    if T is not None:
        return transform(T), ""
    T_initial = np.eye(4) if T_initial is None else transform(T_initial, "T_initial")
    register = getattr(preset.estimator.kind, "register", None)
    if register is None:
        from icpshap.data import registering  # the engine is loaded where it runs

        answer = registering.register_scans(reference, source, T_initial, "the two scans")
        return answer.T_reference_source, OWN_TRUTH
    from icpshap.estimators.callable_registration import called

    end = called(preset.estimator.kind.function(), reference, source, T_initial)
    if end.status != "ok":
        raise DataError(
            f"register: called with the two scans and T_initial, it {end.status}.",
            "give T, or a T_initial that is nearer to the answer.",
        ) from end.error
    return end.T_reference_source, OWN_TRUTH


def _share_of_points(preset, levels):
    """What share of the source's points that the chain's filters leave a run uses."""
    thinned = levels.get("icp_randomness", 1.0)
    return preset.estimator.perturbing.subsampling_probability / thinned


class _Made(NamedTuple):
    """Tables by name; covariances (2, 6, 6), clean and with all causes on; the scans."""

    tables: dict
    covariances: np.ndarray
    scans: Scans


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
        """What comes of it, with so many threads: `_Made`."""
        numbers = self.fit_numbers()
        row = self._describe()
        settings = plan.settings({name: (level,) for name, level in self.levels.items()}, 1)
        # A user's function may hold what two threads must not share.
        alone = self.estimator.kind.foreign
        runs, estimates = estimators.estimate(
            self.pair,
            settings,
            self.estimator,
            self.perturbation.deviation,
            self.streams,
            in_threads(1 if alone else threads, self.said.step),
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
        covariances = self._covariances(runs, estimates, instances, *read_by, scan_pair)
        return _Made(found, covariances, self._scans())

    def _scans(self):
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

    def _covariances(self, runs, estimates, instances, off, returns, method, scan_pair):
        """Covariances (2, 6, 6) of the clean setting and of all causes on, of the runs of f."""
        length = scan_pair.characteristic_length
        replicates = samples(runs, estimates, off, returns, method, length)
        coalitions = coalition_values(instances[list(off)], list(off.values()))
        rows = [sample.rows(coalitions) for sample in replicates]
        return np.stack([covariances(replicates, rows, place, method)[0] for place in (0, -1)])


class _Progress:
    """A line that says how far it is: told at the beginning and the end, and every step between."""

    def __init__(self, progress, parts):
        self.file = sys.stderr if progress is True else progress
        self.parts, self.part, self.steps, self.name = parts, 0, 0, ""

    def begin(self, name):
        self.part, self.steps, self.name = self.part + 1, 0, name
        self._show()

    def step(self):
        self.steps += 1
        self._show()

    def end(self):
        if self.file:
            print("", file=self.file)

    def _show(self):
        if self.file:
            text = f"\r{self.name} ({self.part} of {self.parts}): {self.steps} steps"
            print(text, end="", file=self.file, flush=True)
