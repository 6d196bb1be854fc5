"""How the engine's loops are compiled.

Every loop over points is a numba function with these options. They are compiled on first use and
kept in NUMBA_CACHE_DIR, so only the first job on a machine compiles. No fast-math: every sum has
one order and no two operations are fused, so the same input gives the same bytes.
"""

import functools
import logging
from pathlib import Path

import numba

jit = functools.partial(numba.njit, cache=True, error_model="numpy")

log = logging.getLogger(__name__)


@functools.cache
def announce_compilation(kernel):
    """Log once that `kernel` is about to be compiled, unless the cache holds it already."""
    source = Path(kernel.py_func.__code__.co_filename)
    pattern = f"{source.stem}.{kernel.py_func.__name__}-*.nbi"
    cached = Path(kernel.stats.cache_path).glob(pattern)
    if not any(index.stat().st_mtime >= source.stat().st_mtime for index in cached):
        log.info("Compiling the ICP engine, once on this machine (about half a minute).")
