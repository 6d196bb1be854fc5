"""The table `diagnosis`: a row for each pair of a sequence, against the sequence's other pairs."""

import pandas as pd

from icpshap import causes
from icpshap.diagnosis.diagnose import Known, diagnose, diagnose_alone
from icpshap.diagnosis.diagnostics import NUMBERS
from icpshap.explanation.directions import VECTOR, in_words


def table(pairs, streams):
    """The table of data.pair.Pairs, of which `streams` are the perturb.Streams, in their order.

    Raises DataError for scans that do not overlap.
    """
    known = [Known(pair, of_pair) for pair, of_pair in zip(pairs, streams, strict=True)]
    rows = []
    for place, (one, of_pair) in enumerate(zip(known, streams, strict=True)):
        places = [other for other in range(len(known)) if other != place]
        others = [known[other] for other in places]
        found = diagnose(one, others) if others else diagnose_alone(one, None)
        healthiest = streams[places[found.healthiest]] if others else None
        rows.append(row(found, of_pair, healthiest))
    return pd.DataFrame(rows)


def row(found, streams, healthiest):
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
        "weakest": in_words(diagnostics.direction),
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
