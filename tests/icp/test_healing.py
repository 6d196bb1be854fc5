"""A broken compilation cache is compiled again, not failed on."""

import os
import subprocess
import sys

import pytest
from conftest import REPOSITORY

CODE = """
import numba
from icpshap.icp.healing import heal

def twice(x):
    return 2 * x

twice = heal(numba.njit(twice, cache=True))
assert twice(21) == 42
print(sum(twice.stats.cache_hits.values()))
"""


@pytest.fixture
def run(tmp_path):
    """Run a compiled function in a process of its own: how often the cache served."""
    script = tmp_path / "script.py"
    script.write_text(CODE)
    environment = {
        **os.environ,
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": str(REPOSITORY),
    }

    def run():
        done = subprocess.run(
            [sys.executable, script], env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return int(done.stdout)

    run.cache = tmp_path / "cache"
    return run


def files(run, suffix):
    return sorted(run.cache.rglob(f"*.{suffix}"))


def test_the_cache_serves(run):
    assert [run(), run()] == [0, 1]
    assert files(run, "nbi") and files(run, "nbc")


@pytest.mark.parametrize(
    ("suffix", "damage"),
    [("nbi", "empty"), ("nbi", "flipped"), ("nbc", "cut"), ("nbc", "flipped"), ("nbc", "gone")],
)
def test_a_damaged_file_is_made_again(run, suffix, damage):
    run()
    (path,) = files(run, suffix)
    whole = path.read_bytes()
    middle = len(whole) // 2
    flipped = bytearray(whole)
    flipped[middle] ^= 1
    damaged = {"empty": b"", "cut": whole[:middle], "flipped": bytes(flipped)}
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes(damaged[damage])
    assert run() == 0
    assert run() == 1
