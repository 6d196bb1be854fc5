"""A compilation cache that heals itself.

A power cut or a full disk can leave a file of numba's cache that cannot be read, and every process
would fail on it until somebody deletes it; a flipped bit in it would be run as machine code. Here
every file carries a digest, and one that does not fit is as good as none: it is compiled again.
"""

import hashlib
import pickle

from numba.core import caching
from numba.core.dispatcher import Dispatcher

DIGEST_BYTES = 32


class HealingFile(caching.IndexDataCacheFile):
    """numba's files of one function: index and machine code, each with its digest at the end."""

    def _load_index(self):
        try:
            version, stamp, overloads = _read(self._index_path)
        except OSError:
            return {}
        fits = version == self._version and stamp == self._source_stamp
        return overloads if fits else {}

    def _save_index(self, overloads):
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name):
        return _read(self._data_path(name))

    def _save_data(self, name, data):
        self._write(self._data_path(name), data)

    def _write(self, path, content):
        data = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(data + hashlib.sha256(data).digest())


def _read(path):
    """What a file holds; OSError, on which numba compiles again, if it is not what was written."""
    with open(path, "rb") as file:
        content = file.read()
    data, digest = content[:-DIGEST_BYTES], content[-DIGEST_BYTES:]
    if hashlib.sha256(data).digest() != digest:
        raise OSError(f"{path} is damaged")
    return pickle.loads(data)


def heal(dispatcher: Dispatcher) -> Dispatcher:
    """Let a compiled function that numba caches keep its files as `HealingFile`s."""
    cache = dispatcher._cache  # type: ignore[attr-defined]  # of what numba caches
    stamp = cache._impl.locator.get_source_stamp()
    cache._cache_file = HealingFile(cache._cache_path, cache._impl.filename_base, stamp)
    return dispatcher
