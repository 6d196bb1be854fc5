"""The real pair on which the oracles were computed: its clouds by coalition, range-filtered.

A coalition says of sensor noise, initial pose and overlap whether they are on: "101".
"""

import numpy as np

from icpshap import icp

COALITIONS = ("000", "100", "010", "001", "110", "101", "011", "111")
PLANES = icp.Chain()
POINTS = icp.Chain(icp.PointToPoint(), matches=1, outlier_filter=icp.Trimmed(0.75))


class OraclePair:
    """The clouds of a folder as `ICPSHAP_ORACLE` names it."""

    def __init__(self, folder):
        self.folder = folder
        self.inputs = np.load(folder / "inputs.npz")
        self.T_true = self.inputs["T_gt"]

    def cloud(self, scan, coalition):
        """Points [m] of P1 or P2 before the range filter."""
        kind = ("clean", "noisy")[int(coalition[0])]
        return np.load(self.folder / f"{scan}_{kind}.npy").astype(float)

    def reference(self, coalition):
        points = self.cloud("P1", coalition)
        return points[icp.minimum_range(points, 1.0)]

    def source(self, coalition):
        points = self.cloud("P2", coalition)
        usable = icp.minimum_range(points, 1.0)
        if coalition[2] == "1":
            usable &= self.inputs["P2_keep"]
        return points[usable]


def relative_error(found, expected):
    """Largest difference, relative to the largest of the expected numbers."""
    return np.abs(found - expected).max() / np.abs(expected).max()
