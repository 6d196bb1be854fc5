"""Which settings an experiment runs on each of its pairs, and how they are cut into jobs.

Static: it needs the configuration alone, so that the workflow knows its jobs before there are data.
"""

from dataclasses import dataclass
from itertools import groupby, pairwise, product
from math import ceil

from icpshap.causes import SOURCES


@dataclass(frozen=True)
class Setting:
    """One perturbation that is run, and which set of random draws it uses.

    `values` has one entry per uncertainty source, in their order. `again` marks the second clean
    sample with draws of its own, whose f shows what no perturbation at all would score.
    """

    values: tuple[float, ...]
    replicate: int = 0
    again: bool = False


def settings(levels, replicates):
    """Every setting that the coalitions of a grid of levels need, each once.

    levels maps the name of each uncertainty source to its levels. A coalition puts a source to a
    level or to its reference value: the settings are the grid of levels and reference values.
    """
    axes = [sorted({source.off, *levels[source.name]}) for source in SOURCES]
    clean = tuple(source.off for source in SOURCES)
    return [
        setting
        for replicate in range(replicates)
        for setting in [
            Setting(clean, replicate, again=True),
            *(Setting(values, replicate) for values in product(*axes)),
        ]
    ]


def instances(levels):
    """The perturbations to explain: every combination of the levels, in order."""
    return list(product(*(levels[source.name] for source in SOURCES)))


def jobs(levels, replicates, runs, runs_per_job):
    """The settings of a pair cut into jobs of at most `runs_per_job` ICP runs.

    Settings with the same sensor noise share the perturbed reference and its search index, so they
    stay together where they fit, and are cut evenly where they do not.
    """
    size = max(1, runs_per_job // runs)
    result = [[]]
    noise_levels = groupby(settings(levels, replicates), lambda s: (s.replicate, s.values[0]))
    for _, level in noise_levels:
        level = list(level)
        pieces = ceil(len(level) / size)
        bounds = [len(level) * k // pieces for k in range(pieces + 1)]
        for start, stop in pairwise(bounds):
            if result[-1] and len(result[-1]) + stop - start > size:
                result.append([])
            result[-1] += level[start:stop]
    return result
