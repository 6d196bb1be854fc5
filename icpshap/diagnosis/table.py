"""The table `diagnosis`: a row for each pair of a sequence, against the sequence's other pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from icpshap import causes, plan
from icpshap.diagnosis.diagnose import diagnose
from icpshap.diagnosis.diagnostics import NUMBERS
from icpshap.explanation.directions import VECTOR, in_words

if TYPE_CHECKING:
    from icpshap.diagnosis.diagnose import Diagnosis, Known
    from icpshap.estimators import perturb


def row_of(known: Sequence[Known], place: int) -> dict[str, Any]:
    """The row of a pair of a sequence, by column.

    known: pairs in the order of the sequence, all that are `plan.beside` it at least; place: the
    pair's among them. Numbers of a pair that cannot be measured are NaN.
    """
    around = plan.beside(range(place, place + 1), len(known))
    near = sorted(around, key=lambda other: abs(other - place))[1 : plan.NEIGHBOURS + 1]
    found = diagnose(known[place], [known[other] for other in near])
    healthiest = None if found.healthiest is None else known[near[found.healthiest]].streams
    return row(found, known[place].streams, healthiest)


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
