"""Which columns of a file are x, y and z: by the names that people and programs give them.

Or, where a file does not name its columns, by those that the user says, or as the first three.
"""

import re

import numpy as np

from icpshap.data.formats._lines import AXES, GET_AGAIN, no_time_column, shown
from icpshap.errors import DataError

# Names of a column of x in lower case, with _ for points, colons and blanks; the first of which all
# three axes are there counts. Axes are numbered in tables that ParaView writes.
SPELLINGS = (
    *("{axis}", "{axis}_coordinate", "{axis}_coord", "coordinate_{axis}", "coord_{axis}"),
    *("position_{axis}", "pos_{axis}", "point_{axis}", "points_{axis}", "p{axis}"),
    *("points_{number}", "point_{number}", "coordinates_{number}"),
)
METRES = "m|meters?|metres?"
BY_KEY = "`columns` of the folder, as in `columns: [x, y, z, intensity]`"


def named_axes(names):
    """The places of x, of y and of z among the names of columns: three lists.

    Names that are spelled just so come before all others. Each list has one entry where it is
    certain which column is meant.
    """
    plain = [_plain(name) for name in names]
    candidates = [[[k for k, name in enumerate(names) if name == axis] for axis in AXES]]
    for spelling in SPELLINGS:
        spelled = [spelling.format(axis=axis, number=k) for k, axis in enumerate(AXES)]
        candidates.append([[k for k, name in enumerate(plain) if name == s] for s in spelled])
    for places in candidates:
        if all(places):
            return places
    return max(candidates, key=lambda places: sum(map(bool, places)))


def _plain(name):
    """A name without case, signs of a comment, quotation marks and the unit of metres."""
    name = name.strip().lower().lstrip("#/").strip(" \t\"'")
    name = re.sub(rf"\s*[\[(]({METRES})[\])]$|_({METRES})$", "", name)
    return re.sub(r"[\s.:_-]+", "_", name).strip("_")


def places_by_name(path, names, wanted):
    """Places (k,) of the `wanted` columns, x, y and z first, among the names of a header.

    None where it is not certain which are x, y and z. Raises DataError for a time that is not one
    column.
    """
    axes = named_axes(names)
    if [len(places) for places in axes] != [1] * len(AXES):
        return None
    return [*(place for (place,) in axes), *_times(path, names, wanted)]


def _times(path, names, wanted):
    """Places of the columns that are wanted after x, y and z."""
    for time in wanted[len(AXES) :]:
        if names.count(time) != 1:
            raise no_time_column(path, time, names)
        yield names.index(time)


def places_of(path, width, columns, wanted):
    """Places (k,) of the `wanted` columns, x, y and z first, in a file that names none.

    columns: the names of all ``width`` columns as the user gives them; None: the first three are
    x, y and z. Raises DataError.
    """
    if columns is None:
        if width < len(AXES):
            raise DataError(
                f"{path}: {width} columns, expected x, y and z and perhaps more.", GET_AGAIN
            )
        columns = AXES
    elif len(columns) != width:
        raise DataError(
            f"{path}: {width} columns, but `columns` names {len(columns)}: {', '.join(columns)}.",
            "name every column of the file, in its order.",
        )
    columns = list(columns)
    if any(columns.count(axis) != 1 for axis in AXES):
        raise DataError(
            f"{path}: `columns` names {', '.join(columns)}; expected x, y and z, each once.",
            "name the other columns as you like.",
        )
    return [*map(columns.index, AXES), *_times(path, columns, wanted)]


def require_coordinates(path, points, width):
    """Raise DataError if the first of more than three columns without names counts up.

    points: (n, k) with what was taken for x in its first column; such a column numbers the points
    or says when they were measured.
    """
    if width > len(AXES) and len(points) > 2 and (np.diff(points[:, 0]) > 0).all():
        raise DataError(
            f"{path}: {width} columns without names, of which the first grows from row to row, as"
            " times and numbers of points do; expected x, y and z to be the first three.",
            f"name the columns: {BY_KEY}.",
        )


def unknown_columns(where, names, header):
    """DataError: it is not certain which of the columns of these names are x, y and z."""
    places = named_axes(names)
    missing = [axis for axis, found in zip(AXES, places, strict=True) if not found]
    twice = [axis for axis, found in zip(AXES, places, strict=True) if len(found) > 1]
    problem = f"no {', '.join(missing)}" if missing else f"more than one {', '.join(twice)}"
    return DataError(
        f"{where}: expected a header with the columns x, y and z, each once, or rows of numbers;"
        f" found {shown(header)}, {problem}.",
        "the file may be empty or of another format; name the columns in its first line, in metres,"
        f" or by {BY_KEY}.",
    )
