"""All of it as one JSON document."""

import json

from icpshap.export.format import Format


class Json(Format):
    name = "json"
    meaning = "one JSON document: poses and covariances in the convention of icpshap"

    def texts(self, measurements):
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
