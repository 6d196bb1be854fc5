"""How often an explainer names the cause that matters most, how sure that is, and at what price."""

from collections import defaultdict

import numpy as np

from icpshap.explanation.intervals import wilson

QUANTILE = 1.96  # of the standard normal distribution, for intervals of 95 %
MARGIN = 0.3  # of V between the two best removals, below which either is as good


class Score:
    """Right ones of all by group, counted one by one."""

    def __init__(self):
        self.right, self.number = defaultdict(int), defaultdict(int)

    def count(self, right, *groups):
        for group in groups:
            self.right[group] += bool(right)
            self.number[group] += 1

    def share(self, group):
        """Share and its Wilson interval, of a group that was counted; NaN of none."""
        if group not in self.number:
            return np.nan, np.nan, np.nan
        share = self.right[group] / self.number[group]
        return (share, *wilson(share, self.number[group], QUANTILE))

    def rows(self):
        """A row of each group: its words, cases, share and interval."""
        return [
            [*group, self.number[group], *(round(float(x), 3) for x in self.share(group))]
            for group in self.number
        ]


def share_of_best_drop(named, drops):
    """What the removal of the named cause lowers V by, of the largest drop by cause; 0 of none."""
    best = max(drops.values())
    return max(drops.get(named, 0.0), 0.0) / best
