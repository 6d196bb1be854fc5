"""Which settings an experiment runs on each of its pairs, and how they are cut into jobs.

Static: it needs the configuration alone, so that the workflow knows its jobs before there are data.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise, product
from math import ceil
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from icpshap import causes

if TYPE_CHECKING:
    from icpshap.causes.cause import Cause


Item = TypeVar("Item")

# Of a sequence, in one job: scans that are read or simulated, pairs that are measured and checked,
# pairs that are diagnosed, and pairs that are registered to make the poses. Each is some minutes of
# large scans.
SCANS_PER_JOB = 100
PAIRS_PER_JOB = 100
DIAGNOSES_PER_JOB = 200
# Pairs that a pair is held against where it is diagnosed, none of them farther than that in the
# order of the sequence: a drive goes elsewhere.
NEIGHBOURS = 16
REGISTRATIONS_PER_JOB = 20
# Share of a job of which it is too little to be one: at the end, the one before has it besides.
TOO_LITTLE = 0.25


@dataclass(frozen=True)
class Setting:
    """One perturbation that is run, and which set of random draws it uses.

    `levels` has the name and the value of each cause of the experiment. `again` marks the second
    clean sample with draws of its own, whose f shows what no perturbation at all would score.
    """

    levels: tuple[tuple[str, float], ...]
    replicate: int = 0
    again: bool = False

    @classmethod
    def at(cls, values: Mapping[str, float], replicate: int = 0, again: bool = False) -> Setting:
        """The setting with a mapping of values by cause."""
        return cls(tuple(values.items()), replicate, again)

    @property
    def values(self) -> dict[str, float]:
        """Value by name of the cause."""
        return dict(self.levels)

    def level(self, cause: Cause | type[Cause]) -> float:
        """The value of a cause; one that is not named is off."""
        return self.values.get(cause.name, cause.off)

    def levels_of(self, causes: Iterable[Cause | type[Cause]]) -> tuple[float, ...]:
        """The values of some causes, by which settings can be grouped."""
        return tuple(self.level(cause) for cause in causes)


def settings(levels: Mapping[str, Sequence[float]], replicates: int) -> list[Setting]:
    """Every setting that the coalitions of a grid of levels need, each once.

    levels maps the name of each cause of the experiment to its levels. A coalition puts a cause to
    a level or to its reference value: the settings are the grid of levels and reference values.
    Those that share the perturbed reference stand together.

    >>> for setting in settings({"sensor_noise": [0.02], "initial_pose": [1.5]}, replicates=1):
    ...     print(setting.again, setting.values)
    True {'sensor_noise': 0.0, 'initial_pose': 1.0}
    False {'sensor_noise': 0.0, 'initial_pose': 1.0}
    False {'sensor_noise': 0.0, 'initial_pose': 1.5}
    False {'sensor_noise': 0.02, 'initial_pose': 1.0}
    False {'sensor_noise': 0.02, 'initial_pose': 1.5}
    """
    players = causes.named(levels)
    axes = [sorted({cause.off, *levels[cause.name]}) for cause in players]
    names = [cause.name for cause in players]
    clean = Setting.at({cause.name: cause.off for cause in players})
    found = [
        setting
        for replicate in range(replicates)
        for setting in [
            Setting(clean.levels, replicate, again=True),
            *(
                Setting(tuple(zip(names, values, strict=True)), replicate)
                for values in product(*axes)
            ),
        ]
    ]
    return sorted(found, key=_by_reference(players))


def unknown_levels(names: Iterable[str]) -> dict[str, tuple[float, ...]]:
    """Levels of causes that are known only from data, as far as they decide how many settings.

    One of each, which may turn out to be off: then there are fewer, and later jobs have less to do.
    """
    return {name: causes.CAUSES[name].levels[:1] for name in names}


def instances(levels: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """The perturbations to explain, a value by name of each cause: every combination, in order.

    >>> instances({"sensor_noise": [0.02, 0.05], "initial_pose": [1.5]})
    [{'sensor_noise': 0.02, 'initial_pose': 1.5}, {'sensor_noise': 0.05, 'initial_pose': 1.5}]
    """
    names = [cause.name for cause in causes.named(levels)]
    return [
        dict(zip(names, values, strict=True))
        for values in product(*(levels[name] for name in names))
    ]


class Part(NamedTuple):
    """What a job runs of one of its pairs (reference, source): settings `start` to `stop` - 1."""

    pair: tuple[int, int]
    start: int
    stop: int


def jobs(
    pairs: Iterable[tuple[int, int]],
    levels: Mapping[str, Sequence[float]],
    replicates: int,
    runs: int,
    runs_per_job: int,
) -> list[list[Part]]:
    """The settings of the pairs of a sequence cut into jobs of at most `runs_per_job` runs.

    A job is a list of `Part`s. Settings that share the perturbed reference and its search index
    stay together where they fit, and are cut evenly where they do not. Where less than a quarter of
    a job is left at the end, the one before has it besides. A pair that is added at the end changes
    no job but the last.
    """
    size = max(1, runs_per_job // runs)
    bounds = _bounds(settings(levels, replicates), causes.named(levels), size)
    found: list[dict[tuple[int, int], tuple[int, int]]] = []
    room = 0
    for pair in pairs:
        for start, stop in pairwise(bounds):
            if stop - start > room:
                found.append({})
                room = size
            room -= stop - start
            _add(found[-1], pair, start, stop)
    if len(found) > 1 and size - room < TOO_LITTLE * size:
        for pair, ends in found.pop().items():
            _add(found[-1], pair, *ends)
    return [[Part(pair, *ends) for pair, ends in job.items()] for job in found]


def batches(items: Sequence[Item], size: int) -> list[Sequence[Item]]:
    """A list cut into lists of `size` items; more items at its end change no list but the last.

    Which has up to a quarter more, since less than that is no list of its own.

    >>> batches([1, 2, 3, 4, 5], 2)
    [[1, 2], [3, 4], [5]]
    >>> batches("abcdefghijk", 5)
    ['abcde', 'fghijk']
    """
    starts = list(range(0, len(items), size))
    if len(starts) > 1 and len(items) - starts[-1] < TOO_LITTLE * size:
        starts.pop()
    return [items[start:stop] for start, stop in pairwise([*starts, len(items)])]


def beside(places: range, number: int) -> range:
    """Of so many pairs of a sequence those at some places, with all that they are held against.

    >>> beside(range(100, 200), 1000)
    range(84, 216)
    >>> beside(range(0, 3), 4)
    range(0, 4)
    """
    return range(max(0, places.start - NEIGHBOURS), min(number, places.stop + NEIGHBOURS))


def _add(job, pair, start, stop):
    """Put settings `start` to `stop` - 1 of a pair into a job, behind those that it has of it."""
    first, _ = job.get(pair, (start, stop))
    job[pair] = first, stop


def _by_reference(players):
    """Sort key by which settings that share a reference stand together."""
    on_reference = [cause for cause in players if cause.acts_on("reference")]
    return lambda setting: (setting.replicate, setting.levels_of(on_reference))


def _bounds(settings, players, size):
    """Where the settings of a pair may be cut: pieces of at most `size` with one reference."""
    bounds = [0]
    for _, level in groupby(settings, _by_reference(players)):
        first, length = bounds[-1], len(list(level))
        number = ceil(length / size)
        bounds += [first + length * k // number for k in range(1, number + 1)]
    return bounds
