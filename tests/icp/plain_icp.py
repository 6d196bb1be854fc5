"""A second implementation of the ICP chain, plain numpy and scipy, to check the engine run by run.

It follows the published algorithm step by step and shares nothing with the engine.
"""

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation


def normals(points, neighbours):
    """Unit normals (n, 3) [-], arbitrary sign, from the nearest neighbours, itself included."""
    _, index = cKDTree(points).query(points, neighbours)
    spread = points[index] - points[index].mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", spread, spread))[1][:, :, 0]


def register(
    reference,
    source,
    T_initial,
    planes=True,
    matches=3,
    ratio=0.7,
    maximum_distance=np.inf,
    maximum_iterations=150,
    rotation=1e-3,
    translation=1e-2,
    neighbours=7,
):
    """One run: (T_reference_source (4, 4), iterations, rmse [m], kept links / possible links)."""
    mean = reference.mean(axis=0)
    q_all = reference - mean
    n_all = normals(q_all, neighbours) if planes else None
    tree = cKDTree(q_all)
    p_initial = source @ T_initial[:3, :3].T + T_initial[:3, 3] - mean
    T = np.eye(4)
    angles, lengths = [], []
    for iteration in range(1, maximum_iterations + 1):
        p = p_initial @ T[:3, :3].T + T[:3, 3]
        distance, index = tree.query(p, matches, distance_upper_bound=maximum_distance)
        squared = distance.ravel() ** 2
        linked = np.isfinite(squared)
        rank = int(np.count_nonzero(linked) * ratio)
        ordered = np.sort(squared[linked])
        kept = linked & (squared <= (ordered[rank] if rank < len(ordered) else np.inf))
        p, q = np.repeat(p, matches, axis=0)[kept], q_all[index.ravel()[kept]]
        if planes:
            n = n_all[index.ravel()[kept]]
            F = np.hstack([np.cross(p, n), n])
            error = np.einsum("ij,ij->i", p - q, n)
            x = np.linalg.solve(F.T @ F, -F.T @ error)
            step = np.eye(4)
            step[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix()
            step[:3, 3] = x[3:]
            squared_error = error @ error
        else:
            step = np.eye(4)
            step[:3, :3] = Rotation.align_vectors(q - q.mean(axis=0), p - p.mean(axis=0))[
                0
            ].as_matrix()
            step[:3, 3] = q.mean(axis=0) - step[:3, :3] @ p.mean(axis=0)
            squared_error = ((p - q) ** 2).sum()
        T_next = step @ T
        angles.append(Rotation.from_matrix(step[:3, :3]).magnitude())
        lengths.append(np.linalg.norm(T_next[:3, 3] - T[:3, 3]))
        T = T_next
        if (
            iteration >= 3
            and np.mean(angles[-3:]) < rotation
            and np.mean(lengths[-3:]) < translation
        ):
            break
    T_mean = np.eye(4)
    T_mean[:3, 3] = mean
    result = T_mean @ T @ np.linalg.inv(T_mean) @ T_initial
    return result, iteration, np.sqrt(squared_error / kept.sum()), kept.sum() / kept.size
