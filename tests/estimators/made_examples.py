"""Examples to learn from that no scan gave: what they hold is as a test wants it."""

import numpy as np
import pandas as pd

from icpshap.tables import DESCRIPTOR, covariance_columns


def made_examples(pairs, covariance=lambda descriptor: np.eye(6), sequence="other", seed=0):
    """A descriptors table of so many pairs, one setting each.

    Descriptors are standard normal; covariance(descriptor (d,)): (6, 6).
    """
    generator = np.random.default_rng(seed)
    rows = []
    for index in range(pairs):
        values = generator.standard_normal(len(DESCRIPTOR))
        about = {"sequence": sequence, "reference": index, "source": index + 1, "replicate": 0}
        described = dict(zip(DESCRIPTOR, values, strict=True))
        rows.append({**about, **described, **covariance_columns(covariance(values))})
    return pd.DataFrame(rows)
