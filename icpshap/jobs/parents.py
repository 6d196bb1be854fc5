"""Local jobs end with the run that started them; those of a scheduler do not.

Ctrl-C reaches every process of a terminal, and a Python that is still importing answers with a
traceback. So local jobs do not hear it (`DEAF`): the run does, and stops them.
"""

import os
import threading
import time
from pathlib import Path

PARENT = "ICPSHAP_PARENT"
STOPPED = ".snakemake/icpshap_stopped_{}"  # there once the run of this number stops its jobs
DEAF = "set -euo pipefail; trap '' INT; "  # what a shell does before it starts a job
SECONDS = 0.5  # between two looks


def be_parent() -> None:
    """Tell the jobs that this process starts whose they are."""
    Path(STOPPED.format(os.getpid())).unlink(missing_ok=True)
    os.environ[PARENT] = f"{os.getpid()}:{_born(os.getpid())}"


class CtrlC:
    """Handler of Ctrl-C of a run: its jobs end, and it says `text` instead of a traceback.

    `pressed` tells whether it was called; `has_jobs` is to be set once jobs run, since then
    Snakemake itself has to wait for their end.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.pressed = False
        self.has_jobs = False

    def __call__(self, *_: object) -> None:
        self.pressed = True
        if self.has_jobs:
            Path(STOPPED.format(os.getpid())).touch()
        if not threading.main_thread().is_alive():
            return  # Python waits for other threads: nobody would catch what is raised
        raise KeyboardInterrupt if self.has_jobs else SystemExit(self.text)


def be_nobodys() -> None:
    """Forget a parent: a job of a scheduler may run on another machine."""
    os.environ.pop(PARENT, None)


def end_with_parent() -> None:
    """End this process, in a thread that watches, as soon as its run is gone."""
    if PARENT in os.environ:
        pid, born = os.environ[PARENT].split(":")
        threading.Thread(target=_watch, args=(int(pid), born), daemon=True).start()


def _watch(pid, born):
    stopped = Path(STOPPED.format(pid)).absolute()
    while _born(pid) == born and not stopped.exists():
        time.sleep(SECONDS)
    os._exit(1)


def _born(pid):
    """When a process began, so that none with the same number is taken for it; "" if it is gone."""
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8") as file:
            return file.read().rpartition(")")[2].split()[19]
    except OSError:
        return "" if not _lives(pid) else "unknown"


def _lives(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True
