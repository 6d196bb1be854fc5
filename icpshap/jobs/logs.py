"""Where a job writes: everything into its log, one line for the person who watches."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from icpshap.errors import UserError

INTERRUPTED = "Interrupted."


@contextmanager
def job_log(path: str | Path) -> Iterator[TextIO]:
    """Send all that a job writes, compiled libraries included, to the file `path`.

    Yields the terminal as it was, for the one line that a job says. Of a UserError the message
    alone goes into the log, and the job fails; an interrupt leaves a word, any other exception its
    traceback.
    """
    with open(path, "w", buffering=1, encoding="utf-8", errors="backslashreplace") as log:
        sys.stdout.flush()
        sys.stderr.flush()
        with os.fdopen(
            os.dup(2), "w", buffering=1, encoding="utf-8", errors="backslashreplace"
        ) as terminal:
            os.dup2(log.fileno(), 1)
            os.dup2(log.fileno(), 2)
            logging.basicConfig(level=logging.INFO, format="%(message)s", stream=log, force=True)
            try:
                yield terminal
            except UserError as error:
                logging.error("%s: %s", type(error).__name__, error)
                sys.exit(1)
            except KeyboardInterrupt:
                logging.error(INTERRUPTED)
                sys.exit(130)
