"""Several groups of settings at once: the engine runs without Python's lock."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Taken = TypeVar("Taken")
Made = TypeVar("Made")


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_threads(threads: int, done: Callable[[], None]):
    """A function like `map` whose calls run in that many threads; results come in order.

    done: called as each result is taken. Arguments are made as they are needed, so that few of
    them are in memory.
    """

    def mapped(function: Callable[[Taken], Made], items: Iterable[Taken]) -> Iterator[Made]:
        waiting: deque = deque()
        with ThreadPoolExecutor(threads) as pool:
            try:
                for item in items:
                    waiting.append(pool.submit(function, item))
                    if len(waiting) > threads:
                        yield waiting.popleft().result()
                        done()
                while waiting:
                    yield waiting.popleft().result()
                    done()
            finally:
                # After an error, or Ctrl-C, nothing more begins.
                pool.shutdown(cancel_futures=True)

    return mapped
