"""What an estimator can learn from: descriptors of perturbed pairs, and covariances of runs."""

import logging
from collections import defaultdict

import numpy as np
import pandas as pd

from icpshap.estimators import Estimator, learned, perturb
from icpshap.explanation.sample import samples
from icpshap.explanation.uncertainty import kept_runs
from icpshap.tables import DESCRIPTOR, covariance_columns

log = logging.getLogger(__name__)


def examples(pair, settings, estimator, streams, runs, estimates, method, scan_pair):
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
        if found is not None and seen[setting] is not None:
            values = dict(zip(DESCRIPTOR, seen[setting], strict=True))
            about = {**scan_pair.columns, **setting.values, "replicate": setting.replicate}
            rows.append({**about, **values, **covariance_columns(found)})
    indices = (scan_pair.reference, scan_pair.source)
    log.info("%d-%d: examples of %d of %d settings", *indices, len(rows), len(settings))
    return pd.DataFrame(rows)


def covariance(sample, setting, method):
    """The covariance (6, 6) of a setting with its floor; None if too few runs are left."""
    row = sample.rows(list(setting.values.values()))
    kept = kept_runs(sample, np.array([[row]]), method)
    if kept.sum() < sample.fewest:
        return None
    return sample.spread(row, kept.astype(float), method).covariance[0]


def mean_descriptors(pair, settings, estimator, streams):
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
    return {
        setting: None if any(values is None for values in of_draws) else np.mean(of_draws, axis=0)
        for setting, of_draws in seen.items()
    }
