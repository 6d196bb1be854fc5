"""The checks of the fit table: the number, what is right, the change that mends it, and a grade.

`red` is what breaks an answer, `remark` what colours it, `fits` the rest. A check is a function of
a row of the fit_numbers table; those of the clean setting's runs are added from the uncertainty
table once there is one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from icpshap.data import ground_truth
from icpshap.errors import DataError
from icpshap.tables import PAIR

GRADES = ("red", "remark", "fits")  # the gravest first

RING_SHARE = (
    0.8,
    0.2,
)  # red, remark; of 64 % all clean runs arrived, of 93 % half (docs/own_scans.md)
FEWEST_POINTS = 300, 1000  # of a run
MOST_POINTS = 20_000
DUPLICATES = 0.01
NO_RADIUS = 1e-9  # m, of neighbours that are duplicates of one point
REMOVED = 0.5
TYPICAL_RANGE = 0.3, 300.0  # m; of points in another unit than metres the median lies outside
LITTLE_OVERLAP = 0.4
FAR = 1.0  # m of the median source point from the reference at the true pose
SUCCESS = 0.95
MEMORY = 0.5

AS_ABOVE = "what the other checks propose, else more points, or lidar if the estimator is another"


class Judged(NamedTuple):
    """What a check says of a pair: its number and unit, what is right, a sentence, and a remedy.

    sentence: without its end; remedy: the change that mends it, "" where it fits.
    """

    check: str
    value: float
    unit: str
    expected: str
    grade: str
    sentence: str
    remedy: str


def fits(check: str, value: float, unit: str, expected: str, sentence: str) -> Judged:
    return Judged(check, value, unit, expected, "fits", sentence, "")


# --- before any ICP -------------------------------------------------------------------------------


def rings(row: Any) -> Judged | None:
    """Normals of points on a line are arbitrary: so are those of one ring of a spinning scanner."""
    if np.isnan(row.ring_share):
        return None
    expected = f"at most {RING_SHARE[1]:.0%}"
    sentence = (
        f"{row.ring_share:.0%} of the neighbourhoods of {row.neighbours:.0f} points "
        f"lie on one ring of the scanner ({row.line_share:.0%} on a line in space), where "
        "normals are arbitrary"
    )
    judged = fits("rings", row.ring_share, "-", expected, sentence)
    if row.ring_share <= RING_SHARE[1]:
        return judged
    grade = "red" if row.ring_share > RING_SHARE[0] else "remark"
    if np.isnan(row.mending_neighbours):
        remedy = "scans of more rings"
    else:
        voxels = f"voxel_size: {row.mending_voxel:g}, "
        remedy = f"normal_neighbours: {row.mending_neighbours:.0f}"
        remedy = remedy if np.isnan(row.mending_voxel) else voxels + remedy
    return judged._replace(grade=grade, remedy=remedy)


def narrow_normals(row: Any) -> Judged | None:
    """Normals fitted over less than the noise follow the noise."""
    if np.isnan(row.normal_radius) or not row.largest_noise > 0:
        return None
    radius, noise = row.normal_radius, row.largest_noise
    span = f"normals span {_length(radius)}, noise is {_length(noise)}"
    judged = fits("normals", radius, "m", f"at least the noise, {_length(noise)}", span)
    if radius >= noise:
        return judged
    # Of points on a surface the square of the radius grows with their number.
    wanted = int(np.ceil(row.neighbours * (noise / max(radius, NO_RADIUS)) ** 2 / 5) * 5)
    if wanted <= 50:
        remedy = f"normal_neighbours: {wanted}"
    else:
        remedy = f"voxel_size: {2 * noise:.2g}, and normal_neighbours: 20"
    return judged._replace(grade="remark", remedy=remedy)


def points(row: Any) -> Judged | None:
    """Few points decide a run by which they are."""
    if np.isnan(row.source_points):
        return None
    probability = row.subsampling_probability
    expected = f"{FEWEST_POINTS[1]:,} to {MOST_POINTS:,}"
    sentence = f"a run has {row.source_points:,.0f} source points"
    judged = fits("points", row.source_points, "-", expected, sentence)
    if row.source_points > MOST_POINTS:
        least = max(probability * MOST_POINTS / row.source_points / 2, 1e-3)
        return judged._replace(
            grade="remark", remedy=f"subsampling_probability: {least:.1g}, which is faster"
        )
    if row.source_points >= FEWEST_POINTS[1]:
        return judged
    more = 1.5 * FEWEST_POINTS[1] / max(row.source_points, 1)
    if not np.isnan(row.voxel_size):
        remedy = f"voxel_size: {row.voxel_size / np.sqrt(more):.1g}"
    elif probability * more <= 1:
        remedy = f"subsampling_probability: {probability * more:.1g}"
    else:
        remedy = "denser scans"
    grade = "red" if row.source_points < FEWEST_POINTS[0] else "remark"
    return judged._replace(grade=grade, remedy=remedy)


def overlap_distance(row: Any) -> Judged | None:
    """A distance below the spacing of the points calls what both scans see not overlapping."""
    if np.isnan(row.matched_distance):
        return None
    near = row.matched_distance
    sentence = (
        f"three quarters of what both scans see lie within {_length(near)}, and "
        f"overlap_distance is {_length(row.overlap_distance)}"
    )
    judged = fits("overlap distance", near, "m", "at most overlap_distance", sentence)
    if near <= row.overlap_distance:
        return judged
    remedy = f"perturbation: {{overlap_distance: {_round_up(near)}}}"
    return judged._replace(grade="remark", remedy=remedy)


def overlap(row: Any) -> Judged:
    sentence = f"the overlap ratio is {row.overlap:.2f}"
    judged = fits("overlap", row.overlap, "-", f"{LITTLE_OVERLAP:g} to 1", sentence)
    if row.overlap < LITTLE_OVERLAP:
        return judged._replace(grade="remark", remedy="scans that are nearer to each other")
    if row.overlap > 1:
        return judged._replace(
            grade="remark", remedy="the scan with more points as the reference, by which it counts"
        )
    return judged


def duplicates(row: Any) -> Judged:
    """Coincident points weigh what they are not worth, and have no normals of their own."""
    sentence = f"{row.duplicate_share:.1%} of the points lie where another one does"
    judged = fits("duplicates", row.duplicate_share, "-", f"at most {DUPLICATES:.0%}", sentence)
    if row.duplicate_share <= DUPLICATES:
        return judged
    return judged._replace(grade="remark", remedy="voxel_size: 0.05, or scans without copies")


def nearest_returns(row: Any) -> Judged:
    """What the scanner carries along is at the same place in both scans, and pulls to no motion."""
    minimum = row.minimum_range
    sentence = (
        f"the nearest return is {_length(row.nearest_return)} away, and minimum_range "
        f"{minimum:g} m removes {row.removed_share:.1%} of the points"
    )
    expected = "what moves along with the scanner removed, and little else"
    judged = fits("minimum range", row.nearest_return, "m", expected, sentence)
    if row.removed_share > REMOVED:
        remedy = "a smaller minimum_range, unless these are the robot's own"
        return judged._replace(grade="remark", remedy=remedy)
    if row.nearest_return > 2 * minimum:
        remedy = (
            "a larger minimum_range if the nearest are the vehicle's own, and scans in the frame "
            "of their scanner, from which ranges are measured"
        )
        return judged._replace(grade="remark", remedy=remedy)
    return judged


def units(row: Any) -> Judged:
    low, high = TYPICAL_RANGE
    sentence = f"half of the points are within {_length(row.typical_range)} of the scanner"
    judged = fits("units", row.typical_range, "m", f"{low:g} to {high:g} m", sentence)
    if low <= row.typical_range <= high:
        return judged
    factor = "0.001" if row.typical_range > high else "the one to metres"
    remedy = f"points in metres: multiply by {factor}, and poses alike"
    return judged._replace(grade="red", remedy=remedy)


def true_pose(row: Any) -> Judged:
    sentence = (
        f"at the true pose half of the source points are within {_length(row.median_distance)} of "
        f"the reference (motion {_length(row.motion)})"
    )
    expected = f"within {FAR:g} m, and nearer than with no motion, inverse or transposed"
    judged = fits("true pose", row.median_distance, "m", expected, sentence)
    if row.better_pose:
        return judged._replace(
            grade="red",
            sentence=f"{sentence}, and nearer {row.better_pose}",
            remedy=f"another pose, since {ground_truth.MEANT[row.better_pose]}",
        )
    if row.median_distance > FAR:
        return judged._replace(
            grade="red", remedy="units (metres) and order of scans and poses; or no such pair"
        )
    return judged


CHECKS = (
    units,
    true_pose,
    rings,
    points,
    narrow_normals,
    overlap_distance,
    overlap,
    nearest_returns,
    duplicates,
)


# --- as soon as the clean setting has run ---------------------------------------------------------


def clean_success(row: Any) -> Judged | None:
    """A clean setting whose runs do not arrive is no measure of anything."""
    if np.isnan(row.success_rate):
        return None
    sentence = f"{row.success_rate:.0%} of the clean runs arrive within 0.1 m and 2 degrees"
    expected = f"at least {SUCCESS:.0%}"
    judged = fits("clean success", row.success_rate, "-", expected, sentence)
    if row.success_rate >= SUCCESS:
        return judged
    return judged._replace(grade="red", remedy=AS_ABOVE)


def clean_basin(row: Any) -> Judged:
    """Clean runs that do not lie together have no spread to compare with."""
    sentence = "most of the clean runs lie together"
    judged = fits("clean basin", 1.0 - row.no_basin, "-", "one basin", sentence)
    if not row.no_basin:
        return judged
    return judged._replace(
        grade="red",
        sentence="fewer than half of the clean runs lie together",
        remedy=AS_ABOVE,
    )


def stopping(row: Any) -> Judged | None:
    """Where the start explains the spread, ICP has stopped on its way."""
    if np.isnan(row.largest_memory):
        return None
    sentence = (
        f"the initial pose explains up to {row.largest_memory:.0%} of the spread of a direction in "
        "a setting, where ICP stops on its way"
    )
    expected = f"at most {MEMORY:.0%}"
    judged = fits("stopping", row.largest_memory, "-", expected, sentence)
    if row.largest_memory <= MEMORY:
        return judged
    remedy = "a registration that stops later"
    if not np.isnan(row.stop_rotation):
        tighter = min(1e-5, row.stop_rotation / 10)
        tighter = np.format_float_scientific(tighter, precision=0, trim="-", exp_digits=1)
        remedy = f"stop_rotation: {tighter}, stop_translation: {tighter}"
    return judged._replace(grade="remark", remedy=remedy)


AFTER = (clean_success, clean_basin, stopping)


# --- tables ---------------------------------------------------------------------------------------


def table(numbers: pd.DataFrame) -> pd.DataFrame:
    """The fit table before any ICP: a row of each check of each pair of a fit_numbers table."""
    judged = [
        (row, found)
        for row in numbers.itertuples()
        for check in CHECKS
        if (found := check(row)) is not None
    ]
    return _frame(judged)


def complete(
    numbers: pd.DataFrame, uncertainty: pd.DataFrame, off: Mapping[str, float]
) -> pd.DataFrame:
    """The fit table as soon as the clean settings have run.

    numbers: fit_numbers table; uncertainty: the uncertainty table, by the pairs that were run; off:
    value of each cause that is off, by name.
    """
    run = uncertainty[~uncertainty.again & (uncertainty.replicate == 0) & (uncertainty.n_runs > 0)]
    run = run.assign(largest_memory=run.groupby(PAIR).memory.transform("max"))
    run = run.merge(numbers[[*PAIR, "stop_rotation"]], on=PAIR, how="left")
    clean = run[(run[list(off)] == list(off.values())).all(axis=1)].drop_duplicates(PAIR)
    judged = [
        (row, found)
        for row in clean.itertuples()
        for check in AFTER
        if (found := check(row)) is not None
    ]
    joined = pd.concat([table(numbers), _frame(judged)], ignore_index=True)
    place = {pair: k for k, pair in enumerate(_pairs(numbers))}
    of_rows = [place[pair] for pair in _pairs(joined)]
    return joined.iloc[np.argsort(of_rows, kind="stable")].reset_index(drop=True)


def _pairs(table):
    """The pair of each row: sequence, reference, source."""
    return list(table[PAIR].itertuples(index=False, name=None))


def marked(shap: pd.DataFrame, fit: pd.DataFrame) -> pd.DataFrame:
    """A shap table with `misfit`, what breaks the numbers of its pair."""
    found = red(fit)
    return shap.assign(misfit=[found.get(pair, "") for pair in _pairs(shap)])


def _frame(judged):
    of_pair = pd.DataFrame(
        [[getattr(row, name) for name in PAIR] for row, _ in judged], columns=PAIR
    )
    found = pd.DataFrame([found for _, found in judged], columns=Judged._fields)
    return pd.concat([of_pair, found], axis=1)


def graver_first(fit: pd.DataFrame) -> pd.DataFrame:
    """The rows of a fit table, the gravest first, else in their order."""
    return fit.sort_values("grade", key=lambda grade: grade.map(GRADES.index), kind="stable")


def red(fit: pd.DataFrame) -> dict[tuple[str, int, int], str]:
    """What breaks the answers of the pairs of a fit table, by pair: sentences; "" for nothing."""
    found = {}
    for pair, rows in fit.groupby(PAIR, sort=False):
        rows = rows[rows.grade == "red"]
        # What mends several one after the other is said behind the last.
        remedies = rows.remedy.where(rows.remedy != rows.remedy.shift(-1), "")
        found[pair] = " ".join(map(said, rows.assign(remedy=remedies).itertuples()))
    return found


def require_fit(numbers: pd.DataFrame, pair: tuple[str, int, int]) -> None:
    """Raise DataError where a check of a pair of a fit_numbers table is red.

    pair: sequence, reference, source.
    """
    if broken := red(table(numbers)).get(pair):
        sequence, reference, source = pair
        raise DataError(
            f"{sequence}, scans {reference} and {source}: the settings do not fit the scans. "
            f"{broken}",
            "change them so, or let the run go on with stop_at_red: false.",
        )


def said(row: Any) -> str:
    """A row of a fit table as a sentence, with the change that mends it."""
    text = f"{row.sentence[0].upper()}{row.sentence[1:]}"
    return f"{text}. What may mend it: {row.remedy}." if row.remedy else f"{text}."


def by_check(fit: pd.DataFrame) -> pd.DataFrame:
    """A row for each check over all pairs of a fit table, of the pair where it is gravest.

    Besides the columns of that pair: number, pairs with this grade, and pairs.
    """
    order = {check: k for k, check in enumerate(fit.check.unique())}
    rows = []
    for check, of_check in graver_first(fit).groupby("check", sort=False):
        first = of_check.iloc[0]
        alike = int((of_check.grade == first.grade).sum())
        rows.append({**first, "number": alike, "pairs": len(of_check), "order": order[check]})
    found = pd.DataFrame(rows, columns=[*fit.columns, "number", "pairs", "order"])
    return graver_first(found.sort_values("order")).drop(columns="order").reset_index(drop=True)


def lines(fit: pd.DataFrame, title: str) -> list[str]:
    """A fit table for the console: what does not fit, the gravest first, over all its pairs."""
    checks = by_check(fit)
    wrong = checks[checks.grade != "fits"]
    good = len(checks) - len(wrong)
    if wrong.empty:
        return [f"{title}: the settings fit the scans ({good} checks)"]
    found = [f"{title}: {good} of {len(checks)} checks fit"]
    for row in wrong.itertuples():
        of = f" ({row.number} of {row.pairs} pairs)" if row.pairs > 1 else ""
        found.append(f"  {row.grade.upper() if row.grade == 'red' else row.grade}: {said(row)}{of}")
    return found


# --- words ----------------------------------------------------------------------------------------


def _length(metres):
    """A length in words, in the unit that suits it."""
    if metres < 0.1:
        return f"{100 * metres:.2g} cm"
    return f"{metres:.3g} m" if metres < 1000 else f"{metres:,.0f} m"


def _round_up(metres):
    """A length [m] of two digits, not below it."""
    step = 10.0 ** (np.floor(np.log10(metres)) - 1)
    return f"{np.ceil(metres / step) * step:.2g}"
