"""Local jobs end with the run that started them; those of a scheduler do not."""

import os
import threading
import time

PARENT = "ICPSHAP_PARENT"
SECONDS = 0.5  # between two looks


def be_parent():
    """Tell the jobs that this process starts whose they are."""
    os.environ[PARENT] = f"{os.getpid()}:{_born(os.getpid())}"


def be_nobodys():
    """Forget a parent: a job of a scheduler may run on another machine."""
    os.environ.pop(PARENT, None)


def end_with_parent():
    """End this process, in a thread that watches, as soon as its run is gone."""
    if PARENT in os.environ:
        pid, born = os.environ[PARENT].split(":")
        threading.Thread(target=_watch, args=(int(pid), born), daemon=True).start()


def _watch(pid, born):
    while _born(pid) == born:
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
