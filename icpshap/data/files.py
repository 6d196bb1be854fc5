"""Files that are the user's: what the system refuses is an error that names the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from icpshap.errors import DataError


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """While this lasts, what goes wrong in reading the file at the `Path` is a DataError.

    What is no regular file is refused before it is opened: a pipe would be waited for.
    """
    try:
        if not path.is_file():
            raise DataError(
                f"{path}: {_what_is_there(path)}; expected a file.",
                "correct the path, or put the file there.",
            )
        yield
    except OSError as error:
        raise DataError(
            f"{path}: cannot be read ({error.strerror or error}).",
            "check the permissions of the file and of its folder, and the disk.",
        ) from None


def _what_is_there(path):
    """In words, what a path that is no regular file is."""
    if path.is_dir():
        return "a folder"
    if path.exists():
        return "no regular file but a device, pipe or socket"
    if path.is_symlink():
        return f"a symbolic link to {path.readlink()}, which is not there"
    return "no such file"
