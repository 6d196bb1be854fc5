"""In which order a file has the numbers of its quaternions: said, seen in the scans, or assumed."""

import logging
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from icpshap import se3
from icpshap.data.ground_truth import ROBOT, ground_truth_distance
from icpshap.data.layout import ORDERS, SCALAR_FIRST, SCALAR_LAST
from icpshap.errors import DataError

log = logging.getLogger(__name__)

NAMES = {SCALAR_LAST: ["qx", "qy", "qz", "qw"], SCALAR_FIRST: ["qw", "qx", "qy", "qz"]}
TRANSFORM_COLUMNS = f"tx ty tz {' '.join(NAMES[SCALAR_LAST])}"
TUM_COLUMNS = f"timestamp {TRANSFORM_COLUMNS}"
UPRIGHT = np.deg2rad(30)  # tilt of a scanner that stands on a vehicle or is carried
ROLLED = np.deg2rad(45)  # change of tilt between poses
OVER = np.deg2rad(120)  # tilt of a scanner that has rolled over
NEAR = np.deg2rad(75)  # rotation from the identity, or from lying on its back
MOST_PAIRS = 10  # of scans, by which orders are compared
ENOUGH_PAIRS = 3  # of these that tell


def matrices(translations: np.ndarray, quaternions: np.ndarray, order: str) -> np.ndarray:
    """Poses (n, 4, 4) of translations (n, 3) [m] and quaternions (n, 4) in an order of ORDERS."""
    poses = np.tile(np.eye(4), (len(quaternions), 1, 1))
    scalar_first = order == SCALAR_FIRST
    poses[:, :3, :3] = Rotation.from_quat(quaternions, scalar_first=scalar_first).as_matrix()
    poses[:, :3, 3] = translations
    return poses


def order_of(
    path: str | Path,
    line: int,
    comments: Iterable[tuple[int, str]],
    translations: np.ndarray,
    quaternions: np.ndarray,
    said: str | None = None,
    scan: Callable[[int], np.ndarray] | None = None,
) -> str:
    """The order of a TUM file's quaternions (n, 4), one of ORDERS.

    line: of the first pose; comments: number and words of each; translations (n, 3) [m]; said: what
    the configuration says; scan: function of an index that reads its points, which then decide
    where neither it nor the file says the order. Raises DataError where that is not certain.
    """
    named = _order_in_comments(path, comments)
    if said and named and said != named:
        raise DataError(
            f"{path}: `quaternion: {said}`, but a comment in the file says"
            f" {' '.join(NAMES[named])}.",
            "correct one of them.",
        )
    if said or named:
        return said or named
    if scan is not None:
        both = {order: matrices(translations, quaternions, order) for order in ORDERS}
        if found := _order_by_scans(path, both, scan):
            return found
    _require_scalar_last(path, line, quaternions)
    return SCALAR_LAST


def _order_in_comments(path, comments):
    """The order in which a comment names the columns, or None. Raises DataError for another."""
    for line, words in comments:
        named = [word for word in words if word in NAMES[SCALAR_LAST]]
        if sorted(named) == sorted(NAMES[SCALAR_LAST]):
            for order in ORDERS:
                if named == NAMES[order]:
                    return order
            raise DataError(
                f"{path}, line {line}: the columns are {' '.join(named)}, expected"
                f" {' or '.join(' '.join(names) for names in NAMES.values())}.",
                f"reorder them; columns are {TUM_COLUMNS}.",
            )
    return None


def _order_by_scans(path, both, scan):
    """The only order of which the poses pass the check of ground truth; None if neither does.

    both: poses (n, 4, 4) by order. Raises DataError where both pass, or one here, the other there.
    """
    told, both_pass = set(), False
    number = min(len(next(iter(both.values()))) - 1, MOST_PAIRS)
    telling, source = 0, scan(0)
    for index in range(number):
        reference, source = source, scan(index + 1)
        passing = [
            order
            for order, poses in both.items()
            if not ground_truth_distance(
                reference, source, se3.inverse(poses[index]) @ poses[index + 1], ROBOT
            )[1]
        ]
        log.info("scans %d and %d: ground truth passes as %s", index, index + 1, passing)
        both_pass |= len(passing) == len(both)
        if len(passing) == 1:
            told |= set(passing)
            telling += 1
        if telling == ENOUGH_PAIRS:
            break
    if len(told) == 1:
        return told.pop()
    if told or both_pass:
        seen = "some scans fit one order, some the other" if told else "the scans fit both orders"
        raise DataError(
            f"{path}: it is not certain where the quaternions have qw: {seen}.",
            f"say it: `quaternion: {SCALAR_LAST}` of the folder for {' '.join(NAMES[SCALAR_LAST])},"
            f" as TUM files have it, or `quaternion: {SCALAR_FIRST}`.",
        )
    return None


def _require_scalar_last(path, line, quaternions):
    """Raise DataError if only the order qw qx qy qz makes sense of quaternions (n, 4).

    Angles between poses do not tell: they are the same in both orders. What tells is where up is.
    Read with qw first, the scanner must stay upright in all poses, without being so in the order
    qx qy qz qw, in which it

    - either rolls over between the poses,
    - or lies on its back in all of them, turned about x by nearly half a turn. A scanner may hang
      so; but on its way it turns about the vertical (qy) far more than it rolls (qw).
    """
    a, b, c, d = (quaternions * np.where(quaternions[:, :1] < 0, -1, 1)).T
    tilt = np.arccos(np.clip(1 - 2 * (a**2 + b**2), -1, 1))
    tilt_scalar_first = np.arccos(np.clip(1 - 2 * (b**2 + c**2), -1, 1))
    if tilt_scalar_first.max() > UPRIGHT or tilt.max() <= UPRIGHT:
        return
    rolls_over = np.ptp(tilt) > ROLLED and tilt.max() > OVER
    on_its_back = a.min() > np.cos(NEAR / 2) and np.ptp(b) <= 2 * np.ptp(d)
    if rolls_over or on_its_back:
        raise DataError(
            f"{path}, line {line}: read as {' '.join(NAMES[SCALAR_LAST])}, the scanner"
            f" {'rolls over between the poses' if rolls_over else 'lies on its back'}; read as qw"
            " qx qy qz, it is upright in all of them.",
            f"columns are {TUM_COLUMNS}: move qw to the end, or set `quaternion: {SCALAR_FIRST}`"
            f" of the folder. If it is there already, say so in a line at the top: # {TUM_COLUMNS}",
        )
