"""Matching."""

import numpy as np

from icpshap.icp import kdtree
from icpshap.icp.compiled import jit
from icpshap.icp.minimisers import FEATURES, write_features
from icpshap.icp.trimming import select


@jit
def iterate(
    tree, surface, source, rows, start, active, T, matches, limit, ratio, metric, gram, kept, links
):
    found = np.empty(matches, np.int32)
    distance = np.empty(matches)
    stack = np.empty(kdtree.STACK, np.int32)
    features = np.empty((FEATURES, 1))
    for a in range(active.shape[0]):
        run = active[a]
        n = start[run + 1] - start[run]
        ids = np.empty((n, matches), np.int32)
        d2 = np.empty((n, matches))
        pts = np.empty((n, 3))
        values = np.empty(n * matches)
        count = 0
        for i in range(n):
            s = rows[start[run] + i]
            for axis in range(3):
                pts[i, axis] = (
                    T[run, axis, 0] * source[s, 0]
                    + T[run, axis, 1] * source[s, 1]
                    + T[run, axis, 2] * source[s, 2]
                    + T[run, axis, 3]
                )
            kdtree.nearest(
                tree, pts[i, 0], pts[i, 1], pts[i, 2], matches, limit, found, distance, stack
            )
            for t in range(matches):
                ids[i, t] = found[t]
                d2[i, t] = distance[t]
                if found[t] >= 0:
                    values[count] = distance[t]
                    count += 1
        rank = int(count * ratio)
        threshold = np.inf
        if rank < count:
            threshold = select(values, count, rank)
        gram[run] = 0.0
        links[run] = count
        kept[run] = 0
        for i in range(n):
            for t in range(matches):
                if ids[i, t] >= 0 and d2[i, t] <= threshold:
                    kept[run] += 1
                    write_features(
                        metric, pts[i, 0], pts[i, 1], pts[i, 2], surface[ids[i, t]], features, 0
                    )
                    for u in range(FEATURES):
                        for v in range(FEATURES):
                            gram[run, u, v] += features[u, 0] * features[v, 0]
