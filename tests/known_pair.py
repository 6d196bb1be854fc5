"""A pair of scans that no test looks at, as an explanation knows it."""

import numpy as np

from icpshap import se3
from icpshap.explanation.scan_pair import ScanPair

T_REFERENCE_SOURCE = se3.exp(np.array([0.1, -0.2, 0.4, 1.0, 0.5, 0.0]))
PAIR = ScanPair("room", 0, 1, 3.0, T_REFERENCE_SOURCE)
