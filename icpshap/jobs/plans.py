"""What decides each file: a mapping that the rule plans by, the file carries and its reader checks.

A plan holds configuration, the digest of the code and of the versions that compute, and the digests
of the plans of what the file is made from. Files from outside enter by size and time stamp, since a
time stamp alone misses an older file in the place of a newer. A plan is a rule's parameter, so that
the workflow runs again what has another; it is in the file's metadata, so that a file of another
plan is known when everything else is lost.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from icpshap import causes, options, plan, storage
from icpshap.data import pair as pair_module
from icpshap.data.formats import suffix_of
from icpshap.errors import UserError
from icpshap.jobs import digests
from icpshap.tables import TableError

if TYPE_CHECKING:
    from icpshap.config import Config
    from icpshap.estimators import Estimator


READ_BY = ("columns", "quaternion")  # keys of a folder that decide what its poses are read as
COMPUTING = ("numba", "numpy", "pandas", "pyarrow", "scipy")


@cache
def versions() -> dict[str, str]:
    """The versions that decide numbers, and the architecture; the processor is only recorded."""
    found = {name: metadata.version(name) for name in COMPUTING}
    return {**found, "machine": platform.machine()}


def stamp(path: str | Path) -> dict[str, Any]:
    """A file from outside as far as it is known without reading it; None if it is not there."""
    try:
        status = os.stat(path)
    except OSError:
        return {"path": str(path), "size": None}
    return {"path": str(path), "size": status.st_size, "mtime_ns": status.st_mtime_ns}


def digest(plan: object) -> str:
    """Short digest of a plan, by which two are compared."""
    return storage.digest_of(plan)


def is_settled(path: str | Path, plan: Mapping[str, Any]) -> bool:
    """Whether a file is there and was made by this plan."""
    try:
        return digest(storage.read_about(path).get("plan", {})) == digest(plan)
    except UserError:
        return False


def check(path: str | Path, planned: str) -> None:
    """Raise TableError unless a file was made by the plan of this digest."""
    if digest(storage.read_about(path).get("plan", {})) != planned:
        raise TableError(
            f"{path}: made by another plan.\nHint: remove the file; the workflow makes it again."
        )


def check_estimates(
    files: Iterable[str | Path],
    jobs: Sequence[str],
    planned: Mapping[str, Any],
    pairs: Iterable[str | Path],
) -> None:
    """Raise TableError unless files of runs or estimates are those of an explanation's plan.

    files: in the order of the jobs; jobs: digests of their plans; planned: the plan of the
    explanation; pairs: files of the pairs of the sequence, whose data they must be made from.
    """
    of_pairs = [storage.read_about(path) for path in pairs]
    data = {name: found for about in of_pairs for name, found in about["data"].items()}
    for path, expected in zip(files, jobs, strict=True):
        about = storage.read_about(path)
        found = about.get("plan", {})
        if digest(found) != expected:
            common = {key: planned[key] for key in ("sequence", "seed", "levels")}
            known = difference({key: found.get(key) for key in common}, common)
            raise TableError(
                f"{path}: made by another plan than the one that explains it"
                f"{f' ({known})' if known else ''}.\n"
                "Hint: remove the file; the workflow makes it again."
            )
        for name, made_from in about["data"].items():
            if data.get(name) != made_from:
                raise TableError(
                    f"{path}: made from another {name} than the pairs it holds.\n"
                    "Hint: remove the file; the workflow makes it again."
                )


def difference(found: Mapping[str, Any], planned: Mapping[str, Any]) -> str:
    """What differs between two plans, in words."""
    keys = [
        key
        for key in sorted({*found, *planned})
        if digest(found.get(key)) != digest(planned.get(key))
    ]
    return "; ".join(
        f"{key} {_short(found.get(key))}, planned {_short(planned.get(key))}" for key in keys
    )


def _short(value):
    text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class Plans:
    """The plans of all files of a configuration.

    config: a config.Config; files: scan files and pose file of each folder, by sequence; code:
    function from the name of a script and the plug-ins that it meets to a digest.
    """

    def __init__(
        self,
        config: Config,
        files: Mapping[str, tuple[list[Path], Path | None]],
        code: Callable[..., str],
    ) -> None:
        self.config = config
        self.files = files
        self.code = code
        self._measuring = digests.code_digest(pair_module.__file__)
        self.job = cache(self._job)
        self.jobs = cache(self._jobs)
        self.overlap = cache(self._overlap)
        self.scan = cache(self._scan)
        self.scan_batches = cache(self._scan_batches)
        self.checks = cache(self._checks_of_batch)
        self.batches = cache(self._batches)
        self.batch_of = cache(self._batch_of)
        self.diagnosis_batches = cache(self._diagnosis_batches)
        self.diagnosis_of_batch = cache(self._diagnosis_of_batch)
        self.diagnosis = cache(self._diagnosis)
        self.instances_of_batch = cache(self._instances_of_batch)
        self.instances = cache(self._instances)
        self.explanation = cache(self._explanation)
        # Functions to the plans of what is found of a batch of pairs, and of all, by table.
        self.of_diagnosis = {
            "diagnosis": (self.diagnosis_of_batch, self.diagnosis),
            "instances": (self.instances_of_batch, self.instances),
        }

    def estimator(self, experiment: str) -> Estimator:
        """The estimator of an experiment, with the causes that it names."""
        causes_ = self.config.experiments[experiment].causes
        return self.config.preset(experiment).estimator.of_causes(causes_)

    def variants(self, experiment: str) -> dict[str, dict[str, Any]]:
        """Options of the causes of an experiment that are a variant, by name of the cause."""
        return causes.variants_of(self.estimator(experiment).causes)

    def _variants(self, experiment):
        """The same as part of a plan, of which it is none where every cause is the usual one."""
        found = self.variants(experiment)
        return {"variants": found} if found else {}

    def file_of_scan(self, sequence: str, index: int) -> int:
        """Number of the file that holds a scan."""
        last = len(self.scan_batches(sequence)) - 1
        return min(index // self._scans_per_file(sequence), last)

    def _scans_per_file(self, sequence):
        """One of an archive has its own, since fetched."""
        return 1 if self.config.data[sequence].kind == "archive" else plan.SCANS_PER_JOB

    def _scan_batches(self, sequence):
        """Indices of the scans of each file: those that a pair of any experiment names.

        Of a file without such a scan, which nothing asks for, all that it may hold.
        """
        known = self.config.data[sequence]
        everything = plan.batches(range(known.scans), self._scans_per_file(sequence))
        if known.registers:
            return everything
        experiments = self.config.experiments.values()
        pairs = {pair for found in experiments for pair in found.pairs.get(sequence, ())}
        needed = {index for pair in pairs for index in pair}
        return [[index for index in batch if index in needed] or batch for batch in everything]

    def scans(self, sequence: str, batch: int) -> dict[str, Any]:
        """That of a file of scans."""
        known = self.config.data[sequence]
        indices = self.scan_batches(sequence)[batch]
        if known.kind == "archive":
            return self.scan(sequence, indices[0])
        if known.kind == "folder":
            files = [self.files[sequence][0][index] for index in indices]
            return {"files": [stamp(path) for path in files], **self._read(known, files)}
        return {**self._simulated(known, "simulate_scans"), "scans": list(indices)}

    def _scan(self, sequence, index):
        """What decides a scan, whatever is in one file with it."""
        known = self.config.data[sequence]
        if known.kind == "archive":
            return {**self._archive(known), **self._finite(known), "index": index}
        if known.kind == "folder":
            path = self.files[sequence][0][index]
            return {**stamp(path), **self._read(known, [path])}
        return {**self._simulated(known, "simulate_scans"), "index": index}

    def poses(self, sequence: str) -> dict[str, Any]:
        """That of all poses; how many scans there are decides none of them."""
        known = self.config.data[sequence]
        if known.kind == "archive":
            return self._archive(known)
        if known.registers:
            return {"sequence": sequence, **self._registered(sequence, range(known.scans - 1))}
        if known.folder is not None and (pose_file := self.files[sequence][1]) is not None:
            read = {key: known.folder[key] for key in READ_BY if known.folder.get(key)}
            return {**stamp(pose_file), **read, "code": self.code("read_poses")}
        return self._simulated(known, "simulate_poses")

    def _registered(self, sequence, between):
        """Of poses that are registered: those of `between`, each scan and the one that follows."""
        registrations = [digest(self.registration(sequence, index)) for index in between]
        return {"registrations": registrations, "code": self.code("register_poses")}

    def registration_batches(self, sequence: str) -> list[Sequence[int]]:
        """The scans of each file of registrations, each with the one that follows it."""
        between = range(self.config.data[sequence].scans - 1)
        return plan.batches(between, plan.REGISTRATIONS_PER_JOB)

    def registrations(self, sequence: str, batch: int) -> dict[str, Any]:
        """That of a file of registrations of a scan and the one that follows it."""
        references = self.registration_batches(sequence)[batch]
        return self._registration(sequence, [*references, references[-1] + 1])

    def registration(self, sequence: str, index: int) -> dict[str, Any]:
        """What decides the registration of a scan and the one that follows it."""
        return self._registration(sequence, [index, index + 1])

    def _registration(self, sequence, scans):
        guess = (self.config.data[sequence].folder or {}).get("guess")
        guess = stamp(path) if (path := self.guess(sequence)) else guess
        return {
            "sequence": sequence,
            "pairs": [[index, index + 1] for index in scans[:-1]],
            "scans": [digest(self.scan(sequence, scan)) for scan in scans],
            **({"guess": guess} if guess else {}),
            "code": self.code("register_pairs"),
            "versions": versions(),
        }

    def guess(self, sequence: str) -> str | None:
        """Path of the file that says where the registration of scans starts, or None."""
        folder = self.config.data[sequence].folder or {}
        guess = folder.get("guess")
        return os.path.join(folder["path"], guess) if isinstance(guess, str) else None

    def _truth(self, sequence, pair):
        """What decides the true pose of a pair: of registered scans, those between its two."""
        if not self.config.data[sequence].registers:
            return self.poses(sequence)
        return self._registered(sequence, range(min(pair), max(pair)))

    def _finite(self, known):
        """How rows of a sequence's scans are read."""
        read = {"drop_non_finite": known.drop_non_finite}
        return {**read, "time": known.time} if known.time else read

    def _read(self, known, files):
        """How files of a folder are read; of the scan formats only theirs count."""
        columns = known.folder.get("columns")
        names = {"formats": sorted({suffix_of(path) for path in files})}
        return {
            **self._finite(known),
            **({"columns": columns} if columns else {}),
            "plugins": names,
            "code": self.code("read_scans", *digests.plugins(names)),
        }

    def _archive(self, known):
        """An archive is fetched by name, or read where it lies; the code is no reason to again."""
        if known.archive.get("path"):
            return stamp(known.archive["path"])
        return dict(known.archive)

    def _simulated(self, known, script):
        return {**known.simulated, "seed": self.config.seed, "code": self.code(script)}

    def _overlap(self, sequence, pair):
        """What decides the overlap of a pair, and that it is the one that is registered."""
        return {
            "scans": [digest(self.scan(sequence, index)) for index in pair],
            "poses": digest(self._truth(sequence, pair)),
            "distance": self.config.perturbation.overlap_distance,
            "code": self._measuring,
            "versions": versions(),
        }

    def _batches(self, experiment, sequence):
        """The pairs of each job that measures and checks them."""
        pairs = self.config.experiments[experiment].pairs[sequence]
        return plan.batches(pairs, plan.PAIRS_PER_JOB)

    def _batch_of(self, experiment, sequence):
        """Number of that job by pair."""
        batches = enumerate(self.batches(experiment, sequence))
        return {pair: number for number, pairs in batches for pair in pairs}

    def _checks_of_batch(self, experiment, sequence, batch):
        """That of what is known of the pairs of a job before they are registered.

        It decides no registration.
        """
        return self._checks(experiment, sequence, self.batches(experiment, sequence)[batch])

    def _checks(self, experiment, sequence, pairs):
        found = self.config.experiments[experiment]
        estimator = self.estimator(experiment)
        levels = [
            (name, options.deciding(cause), max(found.levels[name]))
            for name, cause in estimator.causes.items()
            if name in found.levels
        ]
        return {
            "sequence": sequence,
            "pairs": [list(pair) for pair in pairs],
            "overlaps": [digest(self.overlap(sequence, pair)) for pair in pairs],
            "distance": self.config.perturbation.overlap_distance,
            "levels": levels,
            **({"measured": list(found.measured)} if found.measured else {}),
            "estimator": estimator.decides(),
            "plugins": digests.plugin_names(estimator),
            "minimum_overlap": self.config.perturbation.minimum_overlap,
            "seed": self.config.seed,
            "code": self.code("check_pairs", *estimator.plugins),
            "versions": versions(),
        }

    def _diagnosis_batches(self, experiment, sequence):
        """Places, in the order of the sequence, of the pairs of each job that diagnoses them."""
        pairs = self.config.experiments[experiment].pairs[sequence]
        return plan.batches(range(len(pairs)), plan.DIAGNOSES_PER_JOB)

    def pairs_beside(self, experiment: str, sequence: str, places: range) -> list[tuple[int, int]]:
        """The pairs at some places of a sequence, with those that they are held against."""
        pairs = self.config.experiments[experiment].pairs[sequence]
        return [pairs[place] for place in plan.beside(places, len(pairs))]

    def _diagnosis_of_batch(self, experiment, sequence, batch):
        """That of what a job finds to be wrong with its pairs."""
        places = self.diagnosis_batches(experiment, sequence)[batch]
        return self._diagnosis_of(experiment, sequence, places)

    def _diagnosis_of(self, experiment, sequence, places):
        pairs = self.config.experiments[experiment].pairs[sequence]
        among = self.pairs_beside(experiment, sequence, places)
        plugins = {"causes": causes.shown()}
        return {
            "sequence": sequence,
            "pairs": [list(pairs[place]) for place in places],
            "among": [list(pair) for pair in among],
            "overlaps": [digest(self.overlap(sequence, pair)) for pair in among],
            "minimum_range": self.estimator(experiment).perturbing.minimum_range,
            "plugins": plugins,
            "seed": self.config.seed,
            "code": self.code("diagnose_pairs", *digests.plugins(plugins)),
            "versions": versions(),
        }

    def _diagnosis(self, experiment, sequence):
        """That of what is wrong with the pairs of a sequence, which no level decides.

        However they are cut into jobs.
        """
        places = range(len(self.config.experiments[experiment].pairs[sequence]))
        found = digest(self._diagnosis_of(experiment, sequence, places))
        return {
            "sequence": sequence,
            "diagnosis": found,
            "causes": [],  # that the experiment names: of these the table knows nothing
            "code": self.code("join_pairs"),
        }

    def _instances_of_batch(self, experiment, sequence, batch):
        """That of what is played of the pairs of a job, where instances are diagnosed."""
        places = self.diagnosis_batches(experiment, sequence)[batch]
        diagnosis = self.diagnosis_of_batch(experiment, sequence, batch)
        return self._instances_of(experiment, sequence, places, diagnosis)

    def _instances_of(self, experiment, sequence, places, diagnosis):
        found = self.config.experiments[experiment]
        estimator = self.estimator(experiment)
        among = self.pairs_beside(experiment, sequence, places)
        return {
            "sequence": sequence,
            "among": [list(pair) for pair in among],
            "diagnosis": digest(diagnosis),
            "levels": {name: list(levels) for name, levels in found.levels.items()},
            "measured": list(found.measured),
            "causes": [*found.levels, *found.measured],
            **self._variants(experiment),
            "estimator": estimator.decides(),
            "minimum_overlap": self.config.perturbation.minimum_overlap,
            "plugins": digests.plugin_names(estimator),
            "seed": self.config.seed,
            "code": self.code("find_instances", *estimator.plugins),
            "versions": versions(),
        }

    def _instances(self, experiment, sequence):
        """That of what is played of each pair of a sequence, where instances are diagnosed."""
        places = range(len(self.config.experiments[experiment].pairs[sequence]))
        whole = self._diagnosis_of(experiment, sequence, places)
        found = self._instances_of(experiment, sequence, places, whole)
        return {
            "sequence": sequence,
            "instances": digest(found),
            "measured": found["measured"],
            "causes": found["causes"],
            **self._variants(experiment),
            "code": self.code("join_pairs"),
        }

    def _here(self, experiment, sequence):
        """What is diagnosed, as part of a plan, of which it is none where that is not explained."""
        measured = self.config.experiments[experiment].measured
        if not measured:
            return {}
        instances = digest(self.instances(experiment, sequence))
        return {"measured": list(measured), "instances": instances}

    def _jobs(self, experiment, sequence):
        """The parts of each job of a sequence."""
        found = self.config.experiments[experiment]
        return plan.jobs(
            found.pairs[sequence],
            self._levels(experiment),
            found.replicates,
            self.estimator(experiment).number_of_runs,
            self.config.runs_per_job,
        )

    def _levels(self, experiment):
        """The levels of an experiment, as far as they are known before there are data."""
        found = self.config.experiments[experiment]
        return found.levels | plan.unknown_levels(found.measured)

    def settings(self, experiment: str) -> int:
        """Number of the settings of each pair of an experiment."""
        replicates = self.config.experiments[experiment].replicates
        return len(plan.settings(self._levels(experiment), replicates))

    def _job(self, experiment, sequence, job):
        parts = self.jobs(experiment, sequence)[job]
        return {
            **self._estimation(experiment, sequence),
            "pairs": [digest(self.overlap(sequence, part.pair)) for part in parts],
            "parts": [list(part) for part in parts],
        }

    def _estimation(self, experiment, sequence):
        """What decides every estimate of a sequence, however its settings are cut into jobs."""
        found = self.config.experiments[experiment]
        estimator = self.estimator(experiment)
        return {
            "sequence": sequence,
            "levels": {name: list(levels) for name, levels in found.levels.items()},
            **self._here(experiment, sequence),
            "replicates": found.replicates,
            "estimator": estimator.decides(),
            **self._variants(experiment),
            "deviation": self.config.perturbation.deviation.tolist(),
            "plugins": digests.plugin_names(estimator),
            "seed": self.config.seed,
            "code": self.code("run_icp", *estimator.plugins),
            "versions": versions(),
            **self._training(experiment, sequence),
        }

    def _training(self, experiment, sequence):
        """What a sequence's estimator learned from, as part of a plan; nothing if it did not."""
        if (training := self.training(experiment)) is None:
            return {}
        # A list: the order of the examples decides between those that are alike.
        return {
            "training": [
                [other, digest(self.descriptors(training, other))]
                for other in self.training_sequences(experiment, sequence)
            ]
        }

    def training(self, experiment: str) -> str | None:
        """Name of the experiment that the estimator of another one learns from, or None."""
        return self.estimator(experiment).kind.training

    def training_sequences(self, experiment: str, sequence: str) -> list[str]:
        """Those that an experiment's estimator learns from where it is to estimate a sequence."""
        training = self.training(experiment)
        known = self.config.experiments[training].pairs if training else ()
        return [other for other in known if other != sequence]

    def descriptors(self, experiment: str, sequence: str) -> dict[str, Any]:
        """That of what is learned from a sequence of an experiment."""
        estimator = self.estimator(experiment)
        explanation = self.explanation(experiment, sequence)
        decided = ("sequence", "pairs", "estimation", "levels", "method", "seed", "versions")
        return {
            **{key: explanation[key] for key in decided},
            **self._variants(experiment),
            "replicates": self.config.experiments[experiment].replicates,
            "estimator": estimator.decides(),
            "plugins": digests.plugin_names(estimator),
            "code": self.code("train_estimator", *estimator.plugins),
        }

    def job_digests(self, experiment: str, sequence: str) -> list[str]:
        """Digest of the plan of each job; how they are cut is no part of an explanation."""
        jobs = range(len(self.jobs(experiment, sequence)))
        return [digest(self.job(experiment, sequence, job)) for job in jobs]

    def check_digests(self, experiment: str, sequence: str) -> list[str]:
        """Digest of the plan of each job that checks pairs."""
        batches = range(len(self.batches(experiment, sequence)))
        return [digest(self.checks(experiment, sequence, batch)) for batch in batches]

    def batch_digests(self, experiment: str, sequence: str, table: str) -> list[str]:
        """Digest of the plan of each job that finds the diagnosis or the instances of pairs."""
        of_batch, _ = self.of_diagnosis[table]
        batches = range(len(self.diagnosis_batches(experiment, sequence)))
        return [digest(of_batch(experiment, sequence, batch)) for batch in batches]

    def _explanation(self, experiment, sequence):
        found = self.config.experiments[experiment]
        estimator = self.estimator(experiment)
        return {
            "sequence": sequence,
            "pairs": digest(self._checks(experiment, sequence, found.pairs[sequence])),
            "estimation": digest(self._estimation(experiment, sequence)),
            "off": {name: estimator.causes[name].off for name in found.causes},
            "levels": {name: list(levels) for name, levels in found.levels.items()},
            **self._here(experiment, sequence),
            "returns": asdict(estimator.returned),
            **self._variants(experiment),
            "method": options.values(self.config.preset(experiment).method),
            "plugins": digests.plugin_names(estimator),
            "seed": self.config.seed,
            "code": self.code("explain_sequence", *estimator.plugins),
            "versions": versions(),
        }

    def joined(self, experiment: str) -> dict[str, Any]:
        found = self.config.experiments[experiment]
        return {
            "experiment": experiment,
            "causes": list(found.causes),
            **({"measured": list(found.measured)} if found.measured else {}),
            **self._variants(experiment),
            # A list: the order of the rows is part of the table.
            "sequences": [
                [sequence, digest(self.explanation(experiment, sequence))]
                for sequence in found.pairs
            ],
        }
