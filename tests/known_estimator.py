"""An estimator of known distribution, in the place of `icpshap/estimators.py`.

It registers nothing: its pose errors are those of `known_runs`, drawn from the streams of the pair.
"""

import numpy as np
import pandas as pd
from known_runs import pose_errors

from icpshap import se3
from icpshap.causes import NAMES
from icpshap.tables import INITIAL_XI, TRANSFORM, XI


def register_settings(pair, settings, registration, perturbation_settings, streams):
    """The runs table of the settings, as the estimator it stands for makes it."""
    return pd.concat([_setting(pair, setting, registration, streams) for setting in settings])


def _setting(pair, setting, registration, streams):
    streams = streams.branched("again/" if setting.again else "")
    runs = registration.runs
    draws = {
        name: streams.generator(name).standard_normal((runs, 6)) for name in ("shared", *NAMES)
    }
    T = pair.T_reference_source @ se3.exp(pose_errors(setting.values, draws))
    error = se3.log(se3.inverse(pair.T_reference_source) @ T)
    return pd.DataFrame(
        {
            **dict(zip(NAMES, setting.values, strict=True)),
            "replicate": np.int32(setting.replicate),
            "draws": np.int32(setting.again),
            "run": np.arange(runs, dtype=np.int32),
            "noise_draw": np.int32(0),
            **dict(zip(INITIAL_XI, draws["initial_pose"].T, strict=True)),
            **dict(zip(XI, error.T, strict=True)),
            **dict(zip(TRANSFORM, T.reshape(-1, 16).T, strict=True)),
            "iterations": np.int32(10),
            "status": "ok",
            "rmse": 0.01,
            "inlier_ratio": 0.7,
            "wrong_basin": False,
        }
    )
