"""How far the runs of each setting are from the truth: columns of the uncertainty table."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

from icpshap.explanation import readings

if TYPE_CHECKING:
    from icpshap.explanation.sample import Sample


SUCCESS_TRANSLATION = 0.1  # m
SUCCESS_ROTATION = np.deg2rad(2.0)


def pose_error_columns(sample: Sample) -> dict[str, np.ndarray]:
    """Errors (S,) about the ground truth of runs that did not fail, wrong basins included."""
    translation, rotation = (
        np.where(sample.failed, np.nan, error) for error in readings.pose_errors(sample.xi)
    )
    success = (translation <= SUCCESS_TRANSLATION) & (rotation <= SUCCESS_ROTATION)
    with warnings.catch_warnings():
        # NaN is the mean of a setting of which every run failed.
        warnings.filterwarnings("ignore", "Mean of empty slice", RuntimeWarning)
        return {
            "mean_translation_error": np.nanmean(translation, axis=1),
            "mean_rotation_error": np.nanmean(rotation, axis=1),
            "translation_rmse": np.sqrt(np.nanmean(translation**2, axis=1)),
            "rotation_rmse": np.sqrt(np.nanmean(rotation**2, axis=1)),
            "success_rate": np.nanmean(success.astype(float), axis=1),
        }
