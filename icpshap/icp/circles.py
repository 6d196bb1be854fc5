"""Runs that go in circles: rounds that would repeat what has been are counted, not run.

Idea: trimming and matching make the step a function of the pose that is smooth only piece by piece,
so a run may end in a round of a few poses, each a little more than the stopping rule's limit from
the one before, and stay there up to the maximum of iterations. What follows a whole round that came
back to where the last one was is known: the same again. So all further whole rounds are skipped,
and the run goes on with what is left of its iterations. (Of a spinning scanner's 6,150 points on a
0.25 m grid, at limits of 0.1 mm and 0.1 mrad, one run in fifteen ends so, and these took four of
ten iterations.)

Exactness: a round counts as closed if each of its poses is within ROUNDING of the one a round
before, which is what the rounding of sums moves poses by in a round. So a run ends where it would
have ended up to rounding, with the same number of iterations, unless rounding itself decides what
comes next (links of equal length at the threshold), or the stopping rule's limits are below it.

Measured: docs/engine.md.
"""

import numpy as np

from icpshap.icp.compiled import Array, jit

LONGEST = 8  # poses of a round
ROUNDING = 2e-14  # of poses: of their matrices, and in metres


class Circles:
    """The last poses of R runs."""

    def __init__(self, runs: int) -> None:
        self.past = np.full((runs, LONGEST, 3, 4), np.nan)
        self.closed = np.zeros((runs, LONGEST + 1), dtype=np.int64)

    def whole_rounds(self, active: Array, T: Array, turn: int, left: Array) -> Array:
        """Iterations (n,) that the active runs can skip, of the (n,) that are left to each.

        T: (R, 4, 4) poses after iteration `turn`, which rises by one from call to call.
        """
        skipped = _whole_rounds(active, T, turn, left, self.past, self.closed)
        self.past[active, turn % LONGEST] = T[active, :3]
        return skipped


@jit
def _whole_rounds(active, T, turn, left, past, closed):
    skipped = np.zeros(len(active), np.int64)
    for number in range(len(active)):
        run = active[number]
        for length in range(2, LONGEST + 1):
            before = past[run, (turn - length) % LONGEST]
            same = True  # never if a pose is not known yet: it is not a number
            for i in range(3):
                for j in range(4):
                    same &= abs(T[run, i, j] - before[i, j]) <= ROUNDING
            closed[run, length] = closed[run, length] + 1 if same else 0
            if closed[run, length] >= length and skipped[number] == 0:
                skipped[number] = left[number] // length * length
    return skipped
