"""What is said of a line in a scan file that does not fit."""

from icpshap.errors import DataError

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


def too_long(path, line):
    """DataError: a line has more than LONGEST bytes."""
    return DataError(
        f"{path}, line {line}: longer than {LONGEST} bytes, expected a row of a scan.", GET_AGAIN
    )


def shown(text):
    """What a file holds as a message quotes it: on one line, and not all of it if it is long."""
    return repr(text if len(text) <= 60 else text[:57] + "...")
