"""Scans, poses and archives with faults: the tests that attack their readers, each one a fault."""

import re
import subprocess
import sys

from benchmarks.faults.outcome import RIGHT, Outcome, Tried
from benchmarks.faults.workplace import REPOSITORY

TESTS = ("tests/data/test_hostile.py", "tests/data/test_hostile_archives.py")
SECONDS = 1800
RESULT = re.compile(r"^(PASSED|FAILED|ERROR) (\S+::.+?)(?: - (.*))?$", re.M)


def tried(family):
    """Tried of every test; one that fails is wrong, since it says neither more nor less."""
    files = [path for path in TESTS if (REPOSITORY / path).exists()]
    if not files:
        return
    command = [sys.executable, "-m", "pytest", "-q", "-rA", "--tb=no", "-n0", *files]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, timeout=SECONDS)
    for result, name, why in RESULT.findall(done.stdout):
        yield Tried(family, name, RIGHT if result == "PASSED" else Outcome("wrong", why))
