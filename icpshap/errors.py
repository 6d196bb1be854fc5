"""The errors that are the user's to mend."""

from collections.abc import Iterator
from contextlib import contextmanager


class UserError(ValueError):
    """A mistake of the user's; the message says what was expected, and hints at what to do."""


class PerturbationError(UserError):
    """A perturbation cannot be applied to a pair of scans."""


class MissingExtra(UserError):
    """A package is not installed that one of icpshap's extras brings."""


class DataError(UserError):
    """Data that cannot be used: the message names the place, what was expected and what to do."""

    def __init__(self, problem: str, hint: str) -> None:
        super().__init__(f"{problem}\nHint: {hint}")


@contextmanager
def extra(name: str, *packages: str) -> Iterator[None]:
    """Where packages of an extra are imported: a MissingExtra says what to install."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in packages:
            raise
        raise MissingExtra(
            f"{error.name} is not installed.\nHint: pip install 'icpshap[{name}]'"
        ) from None
