"""The library edited while the workflow runs: later jobs would import other code."""

import shutil
import time
from functools import partial

from benchmarks.faults.outcome import Fault, Outcome, said_of
from benchmarks.faults.workplace import REPOSITORY, SECONDS, Workplace

CODE = ("Snakefile", "config.yaml", "icpshap", "workflow", "profiles", "reference")
EDITS = {
    "icpshap/explanation/shapley.py": "\nedited = 1\n",
    "icpshap/plan.py": "\nedited = 1\n",
    "workflow/scripts/explain_sequence.py": "\nedited = 1\n",
    "icpshap/causes/sensor_noise.py": "\nedited = 1\n",
}
HARMLESS = {
    "icpshap/explanation/shapley.py": "\n# a comment\n",
    "icpshap/report/page.py": "\nedited = 1\n",
}


def faults(campaign):
    """Edits of modules that the explanation imports, and of some that decide nothing of it."""
    for name, text in list(EDITS.items())[: 1 if campaign.short else None]:
        yield Fault(f"{name} edited during a run", partial(_edited, campaign, name, text, True))
    if not campaign.short:
        for name, text in HARMLESS.items():
            words = f"{name}: {text.strip()} during a run"
            yield Fault(words, partial(_edited, campaign, name, text, False))


def with_copied_code(campaign, name):
    """A copy of the finished workplace, and code that may be edited."""
    place = campaign.copy(name)
    folder = campaign.folder / f"{name}_code"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for part in CODE:
        source = REPOSITORY / part
        copy = shutil.copytree if source.is_dir() else shutil.copy
        copy(source, folder / part)
    return Workplace(place.folder, folder)


def _edited(campaign, name, text, must_fail):
    """Pairs are checked by the code as it was, and explained after the edit."""
    place = with_copied_code(campaign, "edited")
    file = place.code / name
    before = file.read_text(encoding="utf-8")
    log = place.folder / "logs/check_pairs/tiny_fixed/own/0.log"
    log.unlink()
    process = place.start("--forcerun", "check_pairs", "--", *campaign.tables)
    began = time.monotonic()
    while not log.exists() and process.poll() is None and time.monotonic() - began < SECONDS:
        time.sleep(0.02)
    file.write_text(before + text, encoding="utf-8")
    said, _ = process.communicate(timeout=SECONDS)
    file.write_text(before, encoding="utf-8")
    if process.returncode == 0:
        return place.same_as(campaign.expected) if not must_fail else Outcome("wrong", said[-300:])
    outcome = said_of(said, "CodeError")
    if not must_fail:
        return Outcome("wrong", f"failed without a reason: {said[-300:]}")
    after = place.judged(campaign.expected)
    return outcome if after.kind == "right" else after
