"""What an estimator can learn from: descriptors of perturbed pairs, and covariances of runs."""

from __future__ import annotations

import logging
from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from icpshap.estimators import Estimator, learned, perturb
from icpshap.explanation.sample import samples
from icpshap.explanation.uncertainty import kept_runs
from icpshap.tables import DESCRIPTOR, covariance_columns

if TYPE_CHECKING:
    from icpshap.data.pair import Pair
    from icpshap.explanation.method import Method
    from icpshap.explanation.sample import Sample
    from icpshap.explanation.scan_pair import ScanPair
    from icpshap.plan import Setting


log = logging.getLogger(__name__)


def examples(
    pair: Pair,
    settings: list[Setting],
    estimator: Estimator,
    streams: perturb.Streams,
    runs: pd.DataFrame | None,
    estimates: pd.DataFrame | None,
    method: Method,
    scan_pair: ScanPair,
) -> pd.DataFrame:
    """The rows of a descriptors table that one pair gives: one for each setting that was run.

    pair: data.pair.Pair; settings: list of plan.Setting, all with the same causes; estimator:
    estimators.Estimator; streams: perturb.Streams of the pair: those of which the tables `runs` and
    `estimates` (None if not returned) are; method, scan_pair: how covariances are read off these. A
    setting of which too few runs are left, or in which the clouds hardly overlap, is left out.
    """
    method = method.of_covariances
    settings = [setting for setting in settings if not setting.again]
    causes = list(settings[0].values)
    length = scan_pair.characteristic_length
    replicates = samples(runs, estimates, causes, estimator.returned, method, length)
    seen = mean_descriptors(pair, settings, estimator, streams)
    rows = []
    for setting in settings:
        found = covariance(replicates[setting.replicate], setting, method)
        described = seen[setting]
        if found is not None and described is not None:
            values = dict(zip(DESCRIPTOR, described, strict=True))
            about = {**scan_pair.columns, **setting.values, "replicate": setting.replicate}
            rows.append({**about, **values, **covariance_columns(found)})
    indices = (scan_pair.reference, scan_pair.source)
    log.info("%d-%d: examples of %d of %d settings", *indices, len(rows), len(settings))
    return pd.DataFrame(rows)


def covariance(sample: Sample, setting: Setting, method: Method) -> np.ndarray | None:
    """The covariance (6, 6) of a setting with its floor; None if too few runs are left."""
    row = sample.rows(list(setting.values.values()))
    kept = kept_runs(sample, np.array([[row]]), method)
    if kept.sum() < sample.fewest:
        return None
    return sample.spread(row, kept.astype(float), method).covariance[0]


def mean_descriptors(
    pair: Pair, settings: list[Setting], estimator: Estimator, streams: perturb.Streams
) -> dict[Setting, np.ndarray | None]:
    """The descriptor (d,) of each setting, the mean over the noise draws, by the setting.

    None for one in which the clouds hardly overlap. That the estimator draws the sensor's own noise
    shows in the covariances alone: the scans that these are to be told of hold their own.
    """
    observing = Estimator.decided(
        {**estimator.decides(), "kind": learned.Learned.name, "options": {}}
    )
    seen = defaultdict(list)
    nowhere = np.zeros(6)  # initial poses are not looked at
    for group in perturb.groups(pair, settings, observing, nowhere, streams):
        for same, values in learned.descriptors(group):
            for start in same:
                seen[start.setting].append(values)
    found: dict[Setting, np.ndarray | None] = {}
    for setting, of_draws in seen.items():
        known = [values for values in of_draws if values is not None]
        found[setting] = np.mean(known, axis=0) if len(known) == len(of_draws) else None
    return found
