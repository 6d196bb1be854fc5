"""Of which sequences a job has so little to do that it surely takes seconds.

Such a job runs where the workflow was started, and never waits in a cluster's queue, which would
take longer than its work. By the configuration alone, so that a job is in the same place whatever
files are there: where only a scan tells how many points it has, it may have any number.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING

from icpshap.jobs import time_limits

if TYPE_CHECKING:
    from icpshap.config import Sequence
    from icpshap.jobs.plans import Plans

SECONDS = 20
# The rule of such a job, by the rule of the others.
RULES = {
    "check_pairs": "check_few_pairs",
    "diagnose_pairs": "diagnose_few_pairs",
    "find_instances": "find_few_instances",
    "explain_sequence": "explain_few_settings",
}
# Points of a scan of an archive: those of the Challenging data sets have 367,000 at most.
OF_ARCHIVE = 400_000


def most_points(sequence: Sequence) -> float:
    """How many points a scan of a sequence has at most, as far as the configuration says it."""
    if sequence.simulated is not None:
        return sequence.simulated["beams"]
    return OF_ARCHIVE if sequence.kind == "archive" else inf


def seconds(planner: Plans, experiment: str, sequence: str) -> dict[str, float]:
    """How long the longest job of a sequence, with a pair, takes at most, by the rules of RULES."""
    config = planner.config
    pairs = len(config.experiments[experiment].pairs[sequence])
    points = most_points(config.data[sequence])
    checked = max(map(len, planner.batches(experiment, sequence)))
    batches = planner.diagnosis_batches(experiment, sequence)
    found = max(map(len, batches))
    among = max(len(planner.pairs_beside(experiment, sequence, places)) for places in batches)
    return {
        "check_pairs": checked * points / 1e6 * time_limits.OF_CHECK,
        "diagnose_pairs": time_limits.seconds_of_diagnosis(among, points),
        "find_instances": found * points / 1e6 * time_limits.OF_INSTANCE,
        "explain_sequence": time_limits.seconds_of_explanation(
            pairs * planner.settings(experiment),
            planner.estimator(experiment).number_of_runs,
            config.preset(experiment).method.interval,
        ),
    }


def few(planner: Plans) -> dict[str, list[str]]:
    """By rule, the `experiment/sequence` of which each of its jobs takes less than SECONDS."""
    found: dict[str, list[str]] = {rule: [] for rule in RULES}
    for name, experiment in planner.config.experiments.items():
        for sequence in filter(experiment.pairs.get, experiment.pairs):
            for rule, longest in seconds(planner, name, sequence).items():
                if longest < SECONDS:
                    found[rule].append(f"{name}/{sequence}")
    return found
