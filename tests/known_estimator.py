"""An estimator of known distribution: a file to be put into `icpshap/estimators/`.

It registers nothing: its pose errors are those of `known_runs`, drawn from the streams of the pair.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from known_runs import OFF, pose_errors

from icpshap import se3
from icpshap.estimators.kind import SAMPLES, Kind, Samples


@dataclass(frozen=True)
class Known(Kind):
    """A hundred Gaussian pose errors a setting."""

    name: ClassVar = "known"
    returns: ClassVar = SAMPLES

    def number_of_runs(self, noise_draws):
        return 100

    def estimate(self, group):
        number = len(group.runs)
        draws = {
            name: group.streams.generator(name).standard_normal((number, 6))
            for name in ("shared", *OFF)
        }
        for start in group.starts:
            xi = pose_errors(start.setting.values.values(), draws)
            yield Samples(
                start.setting,
                group.noise_draw,
                group.runs,
                group.pair.T_reference_source @ se3.exp(xi),
                start.initial_xi,
                np.zeros(number, dtype=int),
                np.full(number, "ok"),
                np.zeros(number),
                np.ones(number),
            )
