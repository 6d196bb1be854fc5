"""What is around the workflow: the compilation cache, the language, files under logs/."""

import json
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.faults.outcome import RIGHT, Fault, Outcome, of_call, tail
from benchmarks.faults.workplace import REPOSITORY, SECONDS
from icpshap.jobs import provenance

LANGUAGES = (
    {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    {"LANG": "C", "LC_ALL": "", "PYTHONUTF8": "0"},
    {"LC_ALL": "POSIX", "PYTHONIOENCODING": "ascii"},
)
REGISTER = """
import json, sys
from benchmarks.faults import in_process
with in_process.inside(sys.argv[1]):
    found = in_process.planner(json.loads(sys.argv[2]))
    in_process.register(found, "tiny_fixed", "own", 0, sys.argv[3])
"""


def faults_of_logs(folder, seed):
    """Files of times that a kill or a full disk has left."""
    generator = np.random.default_rng(seed)
    header = "s\th:m:s\n"
    texts = {
        "empty": b"",
        "header alone": header.encode(),
        "half a header": b"s\th:",
        "half a line": (header + "1").encode()[:-1],
        "words": (header + "many\tx\n").encode(),
        "garbage": generator.bytes(200),
        "nulls": bytes(512),
        "quote left open": b's\th:m:s\n"1.0\t0:00:01\n',
        "too many columns": (header + "1\t2\t3\t4\n").encode(),
        "no utf-8": b"s\th:m:s\n\xff\xfe\t1\n",
        "infinite": (header + "inf\t0\n").encode(),
        "a folder": None,
    }
    for words, content in texts.items():
        yield Fault(f"logs/run_icp/tiny_fixed/own/0.tsv: {words}", partial(_times, folder, content))


def _times(folder, content):
    path = Path(folder) / "times" / "run_icp" / "tiny_fixed" / "own" / "0.tsv"
    shutil.rmtree(Path(folder) / "times", ignore_errors=True)
    path.parent.mkdir(parents=True)
    path.with_name("1.tsv").write_text("s\th:m:s\n2.5\t0:00:02\n")
    if content is None:
        path.mkdir()
    else:
        path.write_bytes(content)
    logs = Path(folder) / "times"
    return of_call(
        lambda: provenance.job_times(logs, {"tiny_fixed"}),
        lambda rows: np.isfinite(rows["seconds"]).all() and rows["longest"].iloc[0] >= 1,
        path.name,
    )


def faults_of_cache(campaign, seed, number):
    """Files of the compilation cache damaged; the runs must be the same."""
    generator = np.random.default_rng(seed)
    source = Path(os.environ.get("NUMBA_CACHE_DIR", REPOSITORY / ".cache" / "numba"))
    for k in range(number):
        way = ("cut off", "zero-length", "garbage", "a bit flipped")[k % 4]
        kind = ("nbi", "nbc")[k // 4 % 2]
        place = int(generator.integers(2**31))
        words = f"a .{kind} of the compilation cache: {way}"
        yield Fault(words, partial(_cache, campaign, source, kind, way, place))


def _cache(campaign, source, kind, way, place):
    folder = campaign.folder / "compiled"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(source, folder)
    files = sorted(folder.rglob(f"*.{kind}"))
    file = files[place % len(files)]
    whole = file.read_bytes()
    generator = np.random.default_rng(place)
    damaged = bytearray(whole)
    damaged[place % len(whole)] ^= 1 << place % 8
    content = {
        "cut off": whole[: place % len(whole)],
        "zero-length": b"",
        "garbage": generator.bytes(len(whole)),
        "a bit flipped": bytes(damaged),
    }[way]
    file.write_bytes(content)
    return _registered(campaign, NUMBA_CACHE_DIR=str(folder))


def _registered(campaign, **variables):
    """The runs of a job in a process with these variables, against those that were made."""
    place = campaign.finished
    output = campaign.folder / "registered.parquet"
    output.unlink(missing_ok=True)
    arguments = [str(place.folder), json.dumps(place.config()), str(output)]
    try:
        done = subprocess.run(
            [sys.executable, "-c", REGISTER, *arguments],
            cwd=REPOSITORY,
            env=place.environment(**variables),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=SECONDS,
        )
    except subprocess.TimeoutExpired:
        return Outcome("hang", f"more than {SECONDS} s")
    if done.returncode != 0:
        return Outcome("crash", f"exit code {done.returncode}: {tail(done.stderr)}")
    made = place.folder / "results/tiny_fixed/own/runs/0.parquet"
    same = output.read_bytes() == made.read_bytes()
    return RIGHT if same else Outcome("wrong", "other runs")


def faults_of_cache_folder(campaign):
    """Caches that cannot be written, or are no folder."""
    file = campaign.folder / "no_folder"
    file.write_text("a file")
    yield Fault(
        "the compilation cache is a file", partial(_registered, campaign, NUMBA_CACHE_DIR=str(file))
    )


def faults_of_language(campaign):
    """The tables again, from their sources, in processes that know no utf-8."""
    for variables in LANGUAGES[: 1 if campaign.short else None]:
        words = " ".join(f"{name}={value}" for name, value in variables.items())
        yield Fault(words, partial(_spoken, campaign, variables))


def _spoken(campaign, variables):
    place = campaign.copy("language")
    config = place.config()
    # A title that is no ASCII; it is in no table.
    config["data"]["own"]["title"] = "Größe σ"
    place.configure(config)
    forced = ("--forcerun", "check_pairs", "explain_sequence")
    return place.judged(campaign.expected, arguments=forced, **variables)
