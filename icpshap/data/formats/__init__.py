"""Formats of scan files: every module here is one, and is found by the suffixes that it names.

Such a module has

- ``SUFFIXES``: a tuple of file name endings, in lower case, e.g. ``(".ply",)``;
- ``read(path)``: the points (n, 3), float64 [m], in the scanner frame, of the file at a `Path`.
  Rows that are not finite are left in, since `scans.read_scan` counts them. A file that does not
  fit is a DataError; an OSError becomes one in `scans.read_scan`. No count in a header is believed
  before it is compared with the size of the file. What is slow to import is imported within it:
  every format is imported, whether its files are read or not.

and, if its files can hold the time at which a point was measured,

- ``read_timed(path, time)``: the same with the times after them, (n, 4): the column that the files
  call ``time``. One that is missing is a DataError.

A module whose files need not name their columns has, in place of both,

- ``read_columns(path, columns, wanted)``: the columns (n, k) of the names ``wanted``, which are x,
  y and z and perhaps that of the times, of a file of which the user names all ``columns`` in their
  order; None: as the file names them, or as its format has them.

Nothing else has to know of a format. A module whose name begins with ``_`` is no format but a part
that several share.
"""

import re
from pathlib import Path
from types import ModuleType

from icpshap import registry
from icpshap.data.formats._lines import AXES

COMPRESSED = ".gz"


def suffix_of(path: Path) -> str:
    """The ending by which a file's format is found, in lower case: ".ply" or ".ply.gz".

    >>> suffix_of(Path("scan_7.PLY.gz"))
    '.ply.gz'
    """
    last = path.suffix.lower()
    return Path(path.stem).suffix.lower() + last if last == COMPRESSED else last


def stem_of(name: str) -> str:
    """The name of a file, as text, without the ending of its format."""
    return re.sub(r"\.[A-Za-z]+(\.gz)?$", "", name, flags=re.IGNORECASE)


def _by_suffix(modules):
    """Each module by suffix.

    Raises ImportError for a module that is no format, and for a suffix that no file name can have
    or that two modules claim.
    """
    owners: dict[str, ModuleType] = {}
    for module in modules:
        missing = ["SUFFIXES"] * (not hasattr(module, "SUFFIXES"))
        missing += ["read"] * (not hasattr(module, "read") and not _reads_columns(module))
        if missing:
            raise ImportError(
                f"{module.__file__}: no {' and no '.join(missing)}; expected both in a scan"
                " format.\n"
                "Hint: let the name of a module that is none begin with _."
            )
        for suffix in module.SUFFIXES:
            if suffix_of(Path(f"scan{suffix}")) != suffix:
                raise ImportError(
                    f"{module.__file__}: SUFFIXES = {module.SUFFIXES!r}; expected a tuple of"
                    f" suffixes like '.ply', in lower case and with one dot before any .gz, found"
                    f" {suffix!r}.\n"
                    'Hint: write SUFFIXES = (".ply",), the last comma included.'
                )
            if suffix in owners:
                raise ImportError(
                    f"{owners[suffix].__file__} and {module.__file__}: both have {suffix!r} in"
                    " SUFFIXES; expected one format for each suffix.\n"
                    "Hint: take it out of one of them."
                )
            owners[suffix] = module
    return owners


def _reads_columns(module):
    """Whether the files of a format need not name their columns."""
    return hasattr(module, "read_columns")


def _reader(module):
    """Function of a path that reads x, y and z."""
    if not _reads_columns(module):
        return module.read
    return lambda path: module.read_columns(path, None, AXES)


def _timed_reader(module):
    """Function of a path and the name of a column that reads it after x, y and z."""
    if not _reads_columns(module):
        return module.read_timed
    return lambda path, time: module.read_columns(path, None, (*AXES, time))


# In the order of the modules' names, which is the one of suffixes in messages.
_FORMATS = _by_suffix(registry.modules(__name__, __path__))
READERS = {suffix: _reader(module) for suffix, module in _FORMATS.items()}
TIMED_READERS = {
    suffix: _timed_reader(module)
    for suffix, module in _FORMATS.items()
    if _reads_columns(module) or hasattr(module, "read_timed")
}
COLUMN_READERS = {
    suffix: module.read_columns for suffix, module in _FORMATS.items() if _reads_columns(module)
}
