"""The scale of the initial pose."""

import numpy as np
import pytest

from icpshap.causes.initial_pose import InitialPose

DEVIATION = np.repeat([np.deg2rad(10), 0.2], 3) / np.sqrt(3)


@pytest.mark.parametrize(
    ("scaling", "factor"), [("covariance", np.sqrt(2)), ("standard_deviation", 2)]
)
def test_s_multiplies_what_the_option_says(scaling, factor):
    scaled = InitialPose(initial_pose_scaling=scaling).start(DEVIATION, 2.0)
    np.testing.assert_allclose(scaled, factor * DEVIATION)
