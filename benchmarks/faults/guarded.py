"""Faults that are tried in a process of their own: a crash or an endless loop of it is an outcome.

A family is given by name, since the child must make its faults anew: they are the same for the same
seed, so that a child that takes the place of a dead one goes on behind the fault that killed it.
"""

import multiprocessing
import resource

from benchmarks.faults.outcome import Outcome, Tried

MEMORY = 12 * 2**30  # bytes of address space; compiled code reserves more than it uses
STARTING = 120  # seconds until a child is ready, on a busy machine


def tried(family, make, arguments, seconds):
    """Tried of every fault that `make(*arguments)` yields; each may take so many seconds.

    make: a function of a module, since the child imports it.
    """
    context = multiprocessing.get_context("spawn")
    done, ended = 0, False
    while not ended:
        ours, theirs = context.Pipe(duplex=False)
        child = context.Process(target=_serve, args=(theirs, make, arguments, done), daemon=True)
        child.start()
        theirs.close()
        for message in _messages(ours, seconds):
            if message is None:
                ended = True
                break
            text, outcome = message
            done += 1
            yield Tried(family, text, outcome)
        child.kill()
        child.join()


def _messages(pipe, seconds):
    """(fault, outcome) as they come, then None; a child that dies or hangs ends with its fault."""
    text, limit = None, STARTING
    while True:
        try:
            if not pipe.poll(limit):
                yield text or "(start)", Outcome("hang", f"more than {limit} s")
                return
            message = pipe.recv()
        except EOFError:
            yield text or "(start)", Outcome("crash", "the process died")
            return
        if message is None:
            yield None
            return
        if isinstance(message, str):
            text, limit = message, seconds
        else:
            yield text, message
            # The next fault may first have to be made.
            limit = STARTING


def _serve(pipe, make, arguments, skipped):
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    for number, fault in enumerate(make(*arguments)):
        if number >= skipped:
            pipe.send(fault.text)
            pipe.send(fault.attempt())
    pipe.send(None)
