"""A job of the workflow: where it writes, whose code it runs, and when it ends."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, TextIO

from icpshap.errors import UserError
from icpshap.jobs import digests, parents
from icpshap.jobs.logs import job_log


class CodeError(UserError):
    """The library was edited between the plan and the job."""


@contextmanager
def job(snakemake: Any, script: str) -> Iterator[TextIO]:
    """Run what a script does: into its log, with the code that was planned, while its parent lives.

    script: the script's own file. The parameter `plan`, or the parameters themselves, say what is
    the digest of its `code`, and which `plugins` it meets. Yields the terminal as it was, for the
    one line that a job says. Raises CodeError.
    """
    params = dict(snakemake.params.items())
    plan = params.get("plan", params)
    with job_log(snakemake.log[0]) as terminal:
        parents.end_with_parent()
        # Of a hosted workflow Snakemake runs a copy of the script, and does not say where it is.
        if "code" in plan and os.path.isfile(script):
            plugins = digests.plugins(plan["plugins"]) if "plugins" in plan else ()
            check_code(script, plugins, plan["code"])
        yield terminal


def check_code(script: str, plugins: Iterable[type | ModuleType], planned: str) -> None:
    """Raise CodeError unless the code that is imported has the digest that was planned."""
    found = digests.code_digest(script, plugins)
    if found != planned:
        raise CodeError(
            f"{Path(script).name}: the library has been edited since the run began: its code has "
            f"the digest {found}, planned was {planned}.\n"
            "Hint: leave the library alone while it runs, and run the same command again."
        )
