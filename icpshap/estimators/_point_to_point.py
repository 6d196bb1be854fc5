"""Point-to-point error of poses on mini-batches: what Stein ICP and SGD-ICP have in common.

A pose is [x, y, z, roll, pitch, yaw] [m, rad], with R = Rz(yaw) Ry(pitch) Rx(roll), as in the
released programs of both (Maken, Ramos, Ott: "Stein ICP", 2021; "Bayesian ICP", 2020).
"""

from math import ceil
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation


def pose_of(T, near=None):
    """Poses (..., 6) of transformations (..., 4, 4); angles within pi of those of the pose `near`.

    Without it they lie between -pi and pi.
    """
    angles = Rotation.from_matrix(T[..., :3, :3]).as_euler("xyz")
    if near is not None:
        angles -= 2 * np.pi * np.round((angles - near[3:]) / (2 * np.pi))
    return np.concatenate([T[..., :3, 3], angles], axis=-1)


def transformation_of(pose):
    """Transformations (..., 4, 4) of poses (..., 6)."""
    T = np.zeros((*pose.shape[:-1], 4, 4))
    T[..., :3, :3] = Rotation.from_euler("xyz", pose[..., 3:]).as_matrix()
    T[..., :3, 3] = pose[..., :3]
    T[..., 3, 3] = 1.0
    return T


def rotations(angles):
    """Rotation matrices (k, 3, 3) of angles (k, 3), and their derivatives (k, 3, 3, 3).

    Axis 1 of the derivatives is the angle.
    """
    (x, dx), (y, dy), (z, dz) = (_about(axis, angles[:, axis]) for axis in range(3))
    return z @ y @ x, np.stack([z @ y @ dx, z @ dy @ x, dz @ y @ x], axis=1)


def _about(axis, angle):
    """Rotations (k, 3, 3) about a coordinate axis and their derivatives."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    sine, cosine = np.sin(angle), np.cos(angle)
    rotation, derivative = np.zeros((2, len(angle), 3, 3))
    rotation[:, axis, axis] = 1.0
    rotation[:, one, one] = rotation[:, other, other] = cosine
    rotation[:, other, one], rotation[:, one, other] = sine, -sine
    derivative[:, one, one] = derivative[:, other, other] = -sine
    derivative[:, other, one], derivative[:, one, other] = cosine, -cosine
    return rotation, derivative


class Errors(NamedTuple):
    """Of k poses: mean gradient (k, 6) of half the squared error of their links, and the links.

    links (k,): their number; rmse (k,) [m], NaN without a link.
    """

    gradient: np.ndarray
    links: np.ndarray
    rmse: np.ndarray


def errors(poses, source, reference, match, limit, closest_only=False):
    """The `Errors` of poses (k, 6) on source points (b, 3) [m].

    reference (n, 3) [m]; match: an icp.Matcher of one match on it; limit: squared distance [m^2]
    above which no link is made; closest_only: of the links of a pose that share a reference point,
    whether only the closest counts, the first on ties. Without a link the gradient is 0.
    """
    rotation, derivative = rotations(poses[:, 3:])
    points = source @ np.swapaxes(rotation, 1, 2) + poses[:, None, :3]
    squared, rows = (
        found.reshape(points.shape[:2]) for found in match(points.reshape(-1, 3), limit)
    )
    linked = rows >= 0
    if closest_only:
        linked &= np.array([_closest(*of_pose) for of_pose in zip(squared, rows, strict=True)])
    error = np.where(linked[..., None], points - reference[rows], 0.0)
    links = linked.sum(axis=1)
    translation = error.sum(axis=1)
    # The derivative by an angle is sum e . (dR s) = sum over i and j of dR_ij (sum e_i s_j).
    angles = np.einsum("kaij,kij->ka", derivative, np.swapaxes(error, 1, 2) @ source)
    gradient = np.concatenate([translation, angles], axis=1) / np.maximum(links, 1)[:, None]
    with np.errstate(invalid="ignore"):
        rmse = np.sqrt(np.square(error).sum(axis=(1, 2)) / links)
    return Errors(gradient, links, rmse)


def _closest(squared, rows):
    """Mask (b,) of the closest of the links that share a row."""
    order = np.lexsort((squared, rows))
    mask = np.zeros(len(rows), dtype=bool)
    mask[order] = np.diff(rows[order], prepend=-2) != 0
    return mask


def minibatches_of(group, start, iterations, size):
    """Those (iterations, size) of a perturb.Start: of noise draw k from number k iterations on."""
    first = iterations * group.noise_draw
    return minibatches(group.streams, first, iterations, size, start.rows[0], len(start.source))


def minibatches(streams, first, number, size, rows, count):
    """Rows (number, size) of mini-batches: some of `rows`, out of the `count` rows of a scan.

    Batch t has the first usable ones among the raw row numbers, each as likely, of the stream
    `minibatch/<first + t>`: so a row that is not usable any more changes only its own batches.
    """
    usable = np.zeros(count, dtype=bool)
    usable[rows] = True
    names = (f"minibatch/{first + t}" for t in range(number))
    return np.array([_first_usable(streams.generator(name), size, usable) for name in names])


def _first_usable(generator, size, usable):
    """The first `size` usable rows (size,) of a generator's; at least one must be usable.

    How many are drawn at once cannot be seen: each is one number of the generator.
    """
    found = np.empty(0, dtype=np.int64)
    at_once = ceil(1.5 * size * len(usable) / np.count_nonzero(usable))
    while len(found) < size:
        drawn = (generator.random(at_once) * len(usable)).astype(np.int64)
        found = np.concatenate([found, drawn[usable[drawn]]])
    return found[:size]
