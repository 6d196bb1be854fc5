"""How far off the initial pose is (paper, "Initial Pose Uncertainty")."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from icpshap.causes.cause import Cause
from icpshap.options import Range, option


@dataclass(frozen=True)
class InitialPose(Cause):
    """The covariance of the initial pose is s Sigma (Eq. 4); every run keeps its draw."""

    name: ClassVar = "initial_pose"
    title: ClassVar = "initial pose scale"
    symbol: ClassVar = "s"
    unit: ClassVar = ""
    meaning: ClassVar = "Scale s of the initial pose's covariance"
    off: ClassVar = 1.0
    range: ClassVar = Range(above=0, maximum=10_000)
    colour: ClassVar = "#0072B2"
    levels: ClassVar = (1.2, 1.5, 2.0, 4.0)
    mitigation: ClassVar = "a better start, by odometry or a coarse registration first"
    order: ClassVar = 20
    told: ClassVar = True

    initial_pose_scaling: str = option(
        "covariance",
        "What s multiplies: the covariance (paper) or the standard deviation (released code)",
        choices=("covariance", "standard_deviation"),
    )

    def start(self, deviation: np.ndarray, level: float) -> np.ndarray:
        factor = np.sqrt(level) if self.initial_pose_scaling == "covariance" else level
        return factor * deviation
