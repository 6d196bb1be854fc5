"""The batch loop: match, trim, step, until every run has stopped.

Idea: all runs of a batch take their n-th iteration together, so that they share what one of them
loads from memory; a run that has stopped leaves the batch. Batches are as large as memory allows.

Exactness: a run's sums depend on nothing but its own points, pose and past (see the modules that
make them), and the steps are computed matrix by matrix; so neither the other runs of a batch, nor
their order, nor how many fit into memory can change a bit of the result.

Measured: docs/engine.md.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from icpshap.icp.accumulation import BAND_LINK, QUERIES, KeptLinks, accumulate, band_room
from icpshap.icp.batches import BLOCK, numbered, once_each, used_by_any
from icpshap.icp.chain import Chain
from icpshap.icp.circles import Circles
from icpshap.icp.compiled import Array, announce_compilation, jit
from icpshap.icp.lanes import gram_matrices
from icpshap.icp.order import spatial
from icpshap.icp.reference import Reference, checked_points

STATUS = ("ok", "max_iterations", "too_few_links", "degenerate")
BATCH_BYTES = 170_000_000  # of the positions, bands and past of the runs of a batch
RUN_BYTES = 1_100  # of the poses and sums of a run


@dataclass(frozen=True)
class Registrations:
    """Results of R runs.

    A run that fails ("too_few_links", "degenerate") keeps the pose it had reached: its initial
    pose and the steps taken until then, `iterations` of them. Its error may be NaN.
    """

    T_reference_source: Array  # (R, 4, 4)
    iterations: Array  # (R,) steps taken
    status: Array  # (R,) one of STATUS
    rmse: Array  # (R,) [m] of the kept links in the last matching, under the chain's metric
    inlier_ratio: Array  # (R,) kept links of the last matching / (matches * source points)


def register(
    reference: Reference,
    source: Array,
    rows: Sequence[Array],
    T_initial: Array,
    chain: Chain,
    packets: Sequence[int] | None = None,
) -> Registrations:
    """ICP of R runs: source points (m, 3) [m], source frame, onto a Reference.

    rows: R ascending integer arrays, the source rows each run uses. Runs that are given the same
    array object share the memory for it.
    T_initial: (R, 4, 4), T_reference_source at the start.
    packets: R numbers, equal for runs that use the same rows but for a few, which are then matched
    together where they are near one another; None: for those that are given the same array object.
    They change no byte.
    Returns Registrations. Raises ValueError for points, poses, rows or packets that cannot be used.
    """
    source = checked_points(source, "source cloud")
    rows, T_initial = _checked_runs(rows, T_initial, len(source))
    announce_compilation(accumulate)
    number = _checked_packets(numbered(rows) if packets is None else packets, len(rows))
    sequence = np.argsort(number, kind="stable")
    rows, number = [rows[run] for run in sequence], number[sequence]
    used = used_by_any(rows, len(source))
    # A cloud is not empty, whatever is used of it.
    order = spatial(source, used if len(used) else np.zeros(1, dtype=np.int32))
    position = np.empty(len(source), dtype=np.int32)
    position[order] = np.arange(len(order), dtype=np.int32)
    source = source[order]
    result = Registrations(
        T_reference_source=T_initial[sequence],
        iterations=np.zeros(len(rows), dtype=np.int64),
        status=np.full(len(rows), "max_iterations", dtype=f"<U{max(map(len, STATUS))}"),
        rmse=np.full(len(rows), np.nan),
        inlier_ratio=np.zeros(len(rows)),
    )
    for batch in _batches(np.array([len(run) for run in rows]), len(source), chain.matches):
        positions = once_each(lambda run: np.sort(position[run]), rows[batch])
        kept_links = KeptLinks(reference, source, positions, number[batch], chain)
        _register_batch(reference, kept_links, chain, batch, result)
    given = np.argsort(sequence)
    return Registrations(*(values[given] for values in vars(result).values()))


def _checked_runs(rows, T_initial, source_points):
    T_initial = np.array(T_initial, dtype=float)
    if T_initial.shape != (len(rows), 4, 4):
        raise ValueError(f"T_initial: expected {(len(rows), 4, 4)}, got {T_initial.shape}.")
    rotation = T_initial[:, :3, :3]
    rigid = np.isfinite(T_initial).all(axis=(1, 2))
    rigid[rigid] = (
        np.abs(rotation[rigid] @ rotation[rigid].transpose(0, 2, 1) - np.eye(3)) < 1e-4
    ).all(axis=(1, 2))
    if not rigid.all():
        raise ValueError(f"T_initial of run {np.argmin(rigid)} is not a rigid transformation.")

    def ascending(run):
        if run.dtype.kind not in "iu" or run.ndim != 1:
            return False
        inside = len(run) == 0 or (run[0] >= 0 and run[-1] < source_points)
        return inside and (run[1:] > run[:-1]).all()

    # A list without rows has no type of its own.
    rows = once_each(lambda run: np.asarray(run, int if len(run) == 0 else None), list(rows))
    usable = once_each(ascending, rows)
    if not all(usable):
        raise ValueError(
            f"rows of run {usable.index(False)}: expected ascending whole row numbers below "
            f"{source_points}."
        )
    return rows, T_initial


def _checked_packets(packets, runs):
    # A list without numbers has no type of its own.
    number = np.asarray(packets, int if runs == 0 and len(packets) == 0 else None)
    if number.dtype.kind not in "iu" or number.shape != (runs,):
        raise ValueError(
            f"packets: expected a whole number for each of {runs} runs, got {number.dtype} of "
            f"shape {number.shape}."
        )
    return number.astype(np.int64)


def _batches(lengths, source_points, matches):
    """Slices of runs, of that many points each, that fit into memory and cache together."""
    memory = RUN_BYTES + 4 * lengths + BAND_LINK.itemsize * band_room(matches * lengths)
    share = np.maximum(memory / BATCH_BYTES, lengths * BLOCK / (source_points * QUERIES))
    first, size = 0, 0.0
    for run, needed in enumerate(share):
        if run > first and size + needed > 1.0:
            yield slice(first, run)
            first, size = run, 0.0
        size += needed
    if first < len(lengths):
        yield slice(first, len(lengths))


@jit
def _rotation_angles(T):
    """Angles (R,) [rad] of the rotations of T (R, 4, 4)."""
    # From sine and cosine, as precise for small angles as for large ones.
    result = np.empty(len(T))
    for run in range(len(T)):
        x = T[run, 2, 1] - T[run, 1, 2]
        y = T[run, 0, 2] - T[run, 2, 0]
        z = T[run, 1, 0] - T[run, 0, 1]
        cosine = T[run, 0, 0] + T[run, 1, 1] + T[run, 2, 2] - 1.0
        result[run] = math.atan2(math.sqrt(x * x + y * y + z * z), cosine)
    return result


def _register_batch(reference, kept_links, chain, batch, result):
    """Write the results of the runs in the slice `batch`, those of `kept_links`, into `result`."""
    minimiser, stopping = chain.error_minimiser, chain.stopping
    T_start = result.T_reference_source[batch].copy()
    T_start[:, :3, 3] -= reference.mean  # the steps below act in the reference's centred frame
    runs = len(T_start)
    T = np.tile(np.eye(4), (runs, 1, 1))
    steps = np.empty((runs, 3, 2))  # rotation [rad] and translation [m] of the last three
    iterations = result.iterations[batch]
    status = result.status[batch]
    active = np.arange(runs)
    circles = Circles(runs)
    for turn in itertools.count():
        sums = kept_links(active, T @ T_start)
        enough = sums.kept[active] >= minimiser.minimum_links
        status[active[~enough]] = "too_few_links"
        active = active[enough]
        step, determined = minimiser.step(gram_matrices(sums.products[active]))
        status[active[~determined]] = "degenerate"
        active, step = active[determined], step[determined]
        T_next = step @ T[active]
        steps[active, turn % 3, 0] = _rotation_angles(step)
        steps[active, turn % 3, 1] = np.linalg.norm((T_next - T[active])[:, :3, 3], axis=1)
        T[active] = T_next
        iterations[active] += 1
        if turn >= 2:
            still = steps[active].mean(axis=1) < (stopping.rotation, stopping.translation)
            still = still.all(axis=1)
            status[active[still]] = "ok"
            active = active[~still]
        left = stopping.maximum_iterations - iterations[active]
        left -= circles.whole_rounds(active, T, turn, left)
        iterations[active] = stopping.maximum_iterations - left
        active = active[left > 0]
        if len(active) == 0:
            break
    result.T_reference_source[batch] = T @ T_start
    result.T_reference_source[batch, :3, 3] += reference.mean
    squared_error = minimiser.squared_error(gram_matrices(sums.products[:runs]))
    with np.errstate(invalid="ignore"):
        result.rmse[batch] = np.sqrt(squared_error / sums.kept)
    result.inlier_ratio[batch] = sums.kept / np.maximum(kept_links.possible, 1)
