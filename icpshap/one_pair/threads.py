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


def in_threads(threads: int, done: Callable[[], None]) -> Callable[..., Iterator]:
    """A function like `map` whose calls run in that many threads; results come in order.

    done: called as each result is taken. Arguments are made as they are needed, so that few of
    them are in memory. After an error, or Ctrl-C, nothing more begins, and what runs is not waited
    for.
    """

    def mapped(function: Callable[[Taken], Made], items: Iterable[Taken]) -> Iterator[Made]:
        waiting: deque = deque()
        pool = ThreadPoolExecutor(threads)
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
            pool.shutdown(wait=False, cancel_futures=True)

    return mapped


def one_by_one(done: Callable[[], None]) -> Callable[..., Iterator]:
    """The same in the caller's own thread: of functions that may hold what threads must not share.

    Ctrl-C ends such a function where it is.
    """

    def mapped(function: Callable[[Taken], Made], items: Iterable[Taken]) -> Iterator[Made]:
        for result in map(function, items):
            yield result
            done()

    return mapped
