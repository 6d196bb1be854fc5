"""How long a plan takes on many cores, by list scheduling with measured costs of a job.

A job occupies a core for its work and for what starts before it, each drawn from what was measured.
Those that wait for it may start when the run has noticed its end. The controller is taken to start
a job at once where a core is free, and the file system to be as fast as here.
"""

import heapq
from typing import NamedTuple

import numpy as np


class Measured(NamedTuple):
    """What was measured of jobs: seconds of each, of which the simulation draws.

    overheads: of a core, besides the script; spreads: work of jobs of one kind, relative to their
    median; notice: longest time until an end is noticed [s].
    """

    overheads: list
    spreads: list
    notice: float


class Simulated(NamedTuple):
    """Wall hours of a plan; core hours of its jobs' work and of what they cost besides."""

    hours: float
    work: float
    overhead: float

    @property
    def share(self):
        """Of the overhead in all that cores were occupied for."""
        return self.overhead / (self.overhead + self.work)


def simulated(tasks, cores, measured, seed=1):
    """`Simulated` of planned_work.Task's on so many cores."""
    generator = np.random.default_rng(seed)
    number = len(tasks)
    works = generator.choice(measured.spreads, number) * [task.seconds for task in tasks]
    overheads = generator.choice(measured.overheads, number)
    notices = generator.uniform(0, measured.notice, number)
    waits = [len(task.after) for task in tasks]
    followers = [[] for _ in tasks]
    for index, task in enumerate(tasks):
        for before in task.after:
            followers[before].append(index)
    events = [(0.0, "ready", index) for index in range(number) if not waits[index]]
    heapq.heapify(events)
    ready, free, end = [], cores, 0.0
    while events:
        now, what, index = heapq.heappop(events)
        if what == "ready":
            heapq.heappush(ready, index)
        elif what == "noticed":
            end = max(end, now)
            for follower in followers[index]:
                waits[follower] -= 1
                if not waits[follower]:
                    heapq.heappush(events, (now, "ready", follower))
        else:
            free += 1
            heapq.heappush(events, (now + notices[index], "noticed", index))
        # All that happens now is known before a core is given away.
        if events and events[0][0] == now:
            continue
        while ready and free:
            started = heapq.heappop(ready)
            free -= 1
            over = now + overheads[started] + works[started]
            heapq.heappush(events, (over, "over", started))
    return Simulated(end / 3600, works.sum() / 3600, overheads.sum() / 3600)
