"""How the engine is compiled.

Every loop over points is a numba function with these options, compiled on first use and kept in
NUMBA_CACHE_DIR, so only the first job on a machine compiles. numba looks for changes only in the
file of the function it is asked for, not in those it calls; so the cache has a folder for each
state of this package's files.
"""

import functools
import hashlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core.dispatcher import Dispatcher

from icpshap.icp.healing import heal

OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
BORROWING: dict[str, Any] = {**OPTIONS, "_nrt": False}  # which counts no references
Array = np.ndarray  # for signatures

log = logging.getLogger(__name__)


def jit(function: Callable) -> Dispatcher:
    """The function, compiled when it is first called; threads run it side by side."""
    return heal(numba.njit(function, **OPTIONS))


def jit_borrowing(function: Callable) -> Dispatcher:
    """The same for a function that makes no arrays, and is called often.

    It relies on its caller to hold the arrays it is given. To count for each call that it holds
    them, too, takes two atomic additions for each array, and more time than a candidate.
    """
    return heal(numba.njit(function, **BORROWING))


def _cache_directory():
    package = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(package.glob("*.py")):
        digest.update(source.read_bytes())
    base = numba.config.CACHE_DIR or package / "__pycache__"  # type: ignore[attr-defined]
    return str(Path(base) / f"icp-{digest.hexdigest()[:16]}")


numba.config.CACHE_DIR = _cache_directory()  # type: ignore[attr-defined]  # numba makes it


@functools.cache
def announce_compilation(kernel: Dispatcher) -> None:
    """Log that the engine is compiled, once, if `kernel` is not in the cache already."""
    pattern = f"*.{kernel.py_func.__name__}-*.nbi"
    if not any(Path(str(kernel.stats.cache_path)).glob(pattern)):
        _announce()


@functools.cache
def _announce():
    log.info("Compiling the ICP engine, once on this machine (up to a minute).")
