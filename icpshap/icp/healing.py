"""A compilation cache that heals itself.

A power cut or a full disk can leave a file of numba's cache that cannot be read, and every process
would fail on it until somebody deletes it; a flipped bit in it would be run as machine code. Here
every file carries a digest, and one that does not fit is as good as none: it is compiled again.
"""

from __future__ import annotations

import hashlib
import pickle
from typing import TYPE_CHECKING

from numba.core import caching

if TYPE_CHECKING:
    from numba.core.dispatcher import Dispatcher


DIGEST_BYTES = 32


class HealingFile(caching.IndexDataCacheFile):
    """numba's files of one function: index and machine code, each with its digest at the end."""

    def _load_index(self):
        try:
            with open(self._index_path, "rb") as file:
                version, stamp, overloads = pickle.loads(_checked(file.read()))
        except (OSError, _UnfitError, pickle.UnpicklingError):
            return {}
        fits = version == self._version and stamp == self._source_stamp
        return overloads if fits else {}

    def _save_index(self, overloads):
        data = self._dump((self._version, self._source_stamp, overloads))
        with self._open_for_write(self._index_path) as file:
            file.write(_with_digest(data))

    def load(self, key: object) -> object:
        try:
            return super().load(key)
        except _UnfitError:
            return None

    def _load_data(self, name):
        with open(self._data_path(name), "rb") as file:
            return pickle.loads(_checked(file.read()))

    def _save_data(self, name, data):
        with self._open_for_write(self._data_path(name)) as file:
            file.write(_with_digest(self._dump(data)))


class _UnfitError(Exception):
    """A file is not what was written."""


def _with_digest(data):
    return data + hashlib.sha256(data).digest()


def _checked(data):
    content, digest = data[:-DIGEST_BYTES], data[-DIGEST_BYTES:]
    if hashlib.sha256(content).digest() != digest:
        raise _UnfitError
    return content


def heal(dispatcher: Dispatcher) -> Dispatcher:
    """Let a compiled function that numba caches keep its files as `HealingFile`s."""
    cache = dispatcher._cache  # type: ignore[attr-defined]  # of what numba caches
    cache._cache_file = HealingFile(
        cache_path=cache._cache_path,
        filename_base=cache._impl.filename_base,
        source_stamp=cache._impl.locator.get_source_stamp(),
    )
    return dispatcher
