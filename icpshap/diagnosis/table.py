"""The table `diagnosis`: a row for each pair of a sequence, against the sequence's other pairs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import pandas as pd

from icpshap import causes
from icpshap.diagnosis.diagnose import Known, diagnose
from icpshap.diagnosis.diagnostics import NUMBERS
from icpshap.explanation.directions import VECTOR, in_words

if TYPE_CHECKING:
    from icpshap.data.pair import Pair
    from icpshap.diagnosis.diagnose import Diagnosis
    from icpshap.estimators import perturb


# Pairs that a pair is held against, none of them farther than that in the order of the sequence: a
# drive goes elsewhere.
NEIGHBOURS = 16


def table(loads: Sequence[Callable[[], Pair]], streams: Sequence[perturb.Streams]) -> pd.DataFrame:
    """The table of pairs in their order: functions that load each, and its perturb.Streams.

    A row may be of a pair that cannot be measured; its numbers are NaN then.
    """
    known = [Known(load, of_pair) for load, of_pair in zip(loads, streams, strict=True)]
    rows = []
    for place, one in enumerate(known):
        around = range(max(0, place - NEIGHBOURS), min(len(known), place + NEIGHBOURS + 1))
        near = sorted(around, key=lambda other: abs(other - place))[1 : NEIGHBOURS + 1]
        found = diagnose(one, [known[other] for other in near])
        healthiest = None if found.healthiest is None else streams[near[found.healthiest]]
        rows.append(row(found, streams[place], healthiest))
    return pd.DataFrame(rows)


def row(
    found: Diagnosis, streams: perturb.Streams, healthiest: perturb.Streams | None
) -> dict[str, Any]:
    """The row of a `diagnose.Diagnosis`, by column.

    streams: perturb.Streams of the pair; healthiest: those of the pair that the levels were found
    on, or None.
    """
    verdict, diagnostics = found.verdict, found.diagnostics
    word, names, confidence = verdict.said
    return {
        "sequence": streams.sequence,
        "reference": streams.reference,
        "source": streams.source,
        "against": found.against,
        "healthy_pairs": found.number,
        "healthiest_reference": healthiest.reference if healthiest else -1,
        "healthiest_source": healthiest.source if healthiest else -1,
        **{name: getattr(diagnostics, name) for name in NUMBERS},
        "weakest": in_words(diagnostics.direction) if diagnostics.are_known else "",
        **dict(zip(VECTOR, diagnostics.direction, strict=True)),
        "length": diagnostics.length,
        **{f"level_{name}": verdict.levels[name] for name in causes.shown()},
        **{f"z_{name}": found.z[name] for name in causes.shown()},
        **{f"probability_{name}": verdict.probabilities[name] for name in causes.shown()},
        "probability_nothing": verdict.nothing,
        "verdict": word,
        "causes": ", ".join(names),
        "confidence": confidence,
    }
