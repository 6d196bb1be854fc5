"""How the engine is compiled.

Every loop over points is a numba function with these options. They are compiled on first use and
kept in NUMBA_CACHE_DIR, so only the first job on a machine compiles. Every sum has one order that
depends on its own run alone, so the same input gives the same bytes.
"""

import functools
import logging
from pathlib import Path

import numba
from numba.core import types
from numba.extending import intrinsic

jit = functools.partial(numba.njit, cache=True, error_model="numpy")

log = logging.getLogger(__name__)


@intrinsic
def bits(typing_context, value):
    """The bit pattern of a float64 as int64; for values >= 0 both have the same order."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.int64))

    return types.int64(types.float64), generate


@functools.cache
def announce_compilation(kernel):
    """Log once that `kernel` is about to be compiled, unless the cache holds it already."""
    source = Path(kernel.py_func.__code__.co_filename)
    pattern = f"{source.stem}.{kernel.py_func.__name__}-*.nbi"
    cached = Path(kernel.stats.cache_path).glob(pattern)
    if not any(index.stat().st_mtime >= source.stat().st_mtime for index in cached):
        log.info("Compiling the ICP engine, once on this machine (about half a minute).")
