"""A working directory in which tests run the workflow as a user does."""

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from hashlib import sha256

from conftest import REPOSITORY

from icpshap.jobs import few

TINY = REPOSITORY / "tests" / "tiny.yaml"
TINY_ESTIMATORS = TINY.with_name("tiny_estimators.yaml")
CODE = ("Snakefile", "config.yaml", "icpshap", "workflow", "profiles", "reference")


class Project:
    """A working directory with tiny.yaml; the code is the repository's.

    Only tests that edit code use a copy of it: each copy would compile the ICP engine anew.
    """

    def __init__(self, folder, code=REPOSITORY):
        self.folder = folder
        self.code = code
        if not (folder / TINY.name).exists():
            shutil.copy(TINY, folder)

    def with_copied_code(self, folder):
        """The same working directory, and code that a test may edit."""
        for part in CODE:
            source = REPOSITORY / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, folder / part)
        return Project(self.folder, code=folder)

    def run(self, *arguments, cores=2, fails=False):
        """What snakemake says; stdout and stderr together."""
        command = [sys.executable, "-m", "snakemake", f"-j{cores}"]
        command += ["--snakefile", str(self.code / "Snakefile"), *arguments]
        done = subprocess.run(
            command,
            cwd=self.folder,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert (done.returncode != 0) == fails, done.stdout
        return done.stdout

    def tiny(self, *arguments, **keywords):
        return self.run("--configfile", "tiny.yaml", *arguments, **keywords)

    def planned(self, *arguments):
        """Jobs by rule that a dry run plans; those of few pairs are with the others."""
        return together(planned_jobs(self.run("-n", *arguments)))

    def digests(self, pattern):
        return {
            str(path.relative_to(self.folder)): sha256(path.read_bytes()).hexdigest()
            for path in sorted(self.folder.glob(pattern))
        }


def planned_jobs(said):
    """Jobs by rule, as a dry run says them."""
    return {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", said, re.M)}


def together(jobs):
    """Jobs by rule, those of few pairs with those of the rule whose files they make."""
    rules = {of_few: rule for rule, of_few in few.RULES.items()}
    found = Counter()
    for rule, count in jobs.items():
        found[rules.get(rule, rule)] += count
    return dict(found)


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
