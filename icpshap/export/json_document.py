"""All of it as one JSON document."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from icpshap.export.format import Format

if TYPE_CHECKING:
    from icpshap.export.measurement import Measurement


class Json(Format):
    name = "json"
    meaning = "one JSON document: poses and covariances in the convention of icpshap"

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        document = {
            "order": "rotation first",
            "unit": "rad^2, rad m, m^2",
            "frame": "of xi in T_reference_source exp(xi), in the frame of the source",
            "measurements": [
                {
                    "sequence": one.sequence,
                    "reference": one.reference,
                    "source": one.source,
                    "levels": one.levels,
                    "T_reference_source": one.T_reference_source.tolist(),
                    "covariance": one.covariance.tolist(),
                    "n_used": one.n_used,
                    "n_runs": one.n_runs,
                }
                for one in measurements
            ],
        }
        return {"": json.dumps(document, indent=1) + "\n"}
