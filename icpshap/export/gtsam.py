"""A pose graph for gtsam.readG2o, whose factors then have the covariance of gtsam.Pose3.

The file is g2o's, but the information is of [translation; turn], which that reader swaps and leaves
as it is; g2o itself would take the turn for the vector part of a quaternion.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from icpshap import conventions
from icpshap.export.format import Format
from icpshap.export.g2o import graph

if TYPE_CHECKING:
    from icpshap.export.measurement import Measurement


class Gtsam(Format):
    name = "gtsam"
    meaning = "a pose graph for gtsam.readG2o(file, True): BetweenFactorPose3 with its covariance"

    def texts(self, measurements: Sequence[Measurement]) -> dict[str, str]:
        return {"": graph(measurements, self.name, conventions.translation_first)}
