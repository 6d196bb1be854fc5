"""What is said of a line in a scan file that does not fit."""

from icpshap.errors import DataError

AXES = ("x", "y", "z")
GET_AGAIN = "the file may be cut off or edited; get or export it again."
LONGEST = 2**20  # bytes of a line; a longer one is no row of a scan


def wrong_width(path, line, found, expected):
    """DataError: ``line``, counted from 1, has ``found`` columns and not ``expected``."""
    return DataError(f"{path}, line {line}: {found} columns, expected {expected}.", GET_AGAIN)


def not_a_number(path, line, column, cell):
    """DataError: the text ``cell`` in the column of this name is no number."""
    return DataError(
        f"{path}, line {line}, column {column}: {shown(cell)} is not a number.",
        f"numbers are written like -1.5 or 2e-3, with a point; {GET_AGAIN}",
    )


def no_time_column(path, time, names):
    """DataError: among the columns of these names is not just one that is called ``time``."""
    found = f"{names.count(time)} of them" if time in names else "none"
    return DataError(
        f"{path}: expected one column {shown(time)} with the times of the points, found {found};"
        f" its columns are {shown(', '.join(names))[1:-1]}.",
        "set `time` of the sequence to the name of the column, or leave it out: `scan_order` then"
        " says in which order the points were measured.",
    )


def is_number(text):
    """Whether a cell is a number as files write it; Python's own 1_0 is none."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text


def too_long(path, line):
    """DataError: a line has more than LONGEST bytes."""
    return DataError(
        f"{path}, line {line}: longer than {LONGEST} bytes, expected a row of a scan.", GET_AGAIN
    )


def shown(text):
    """What a file holds as a message quotes it: on one line, and not all of it if it is long."""
    return repr(text if len(text) <= 60 else text[:57] + "...")
