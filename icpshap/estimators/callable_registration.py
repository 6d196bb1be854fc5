"""Your own registration, a Python function, from many initial poses: each end a pose sample."""

from __future__ import annotations

import difflib
import inspect
import logging
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from types import ModuleType
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import numpy as np

from icpshap import registry, rigid
from icpshap.errors import MissingExtra, UserError
from icpshap.estimators._own_noise import OwnNoise, Runs
from icpshap.estimators.kind import SAMPLES, Samples
from icpshap.options import REQUIRED, option

if TYPE_CHECKING:
    import pandas as pd

    from icpshap.estimators.kind import Covariance
    from icpshap.estimators.perturb import Group


log = logging.getLogger(__name__)

LONGEST = 200  # characters of a status


@dataclass(frozen=True, kw_only=True)
class CallableRegistration(OwnNoise, Runs):
    """`runs` calls of `register` a setting: (reference, source, T_initial) -> T_reference_source.

    Each call gets copies: the perturbed reference (n, 3) [m], the source points (m, 3) [m] of the
    run's own subsample, its initial pose (4, 4); all of float64 in C order. A call that raises, or
    does not return a pose, is a failed run, and its status says in words what happened. From Python
    `register` may be the function itself. The closed form of the sensor's own noise takes links to
    the nearest point, where a call from the true pose ends.
    """

    name: ClassVar = "callable"
    returns: ClassVar = SAMPLES
    foreign: ClassVar = True
    # From all points a registration without chance of its own would end where its stopping rule
    # says, whatever its initial pose: there would be no clean spread to compare with.
    defaults: ClassVar = {"subsampling_probability": 0.5}

    register: str | Callable = option(
        REQUIRED,
        "The function, as module:function; the module is installed, or a file of the working "
        "directory",
        schema={"type": "string", "pattern": r"^[A-Za-z_][A-Za-z0-9_.]*:[A-Za-z_][A-Za-z0-9_]*$"},
    )

    @property
    def conflict(self) -> str:
        try:
            self.function()
        except UserError as error:
            return f"register: {' '.join(str(error).split())}"
        return ""

    @property
    def modules(self) -> tuple[ModuleType, ...]:
        if callable(self.register):
            return ()
        return (registry.imported(self.register.partition(":")[0]),)

    def function(self) -> Callable:
        """The function that is called. Raises UserError if `register` leads to none."""
        return self.register if callable(self.register) else found(self.register)

    def check_clean(self, runs: pd.DataFrame) -> None:
        if (runs["status"] != "ok").all():
            raise UserError(
                f"{self._called}: all {len(runs)} runs of the unperturbed pair failed; the first "
                f"{runs['status'].iloc[0]}.\n"
                "Hint: call it with two scans and an initial pose yourself; it must return the "
                "rigid transformation (4, 4) from the source's frame to the reference's."
            )

    @property
    def _run_of(self):
        return f"calls of {self._called.rpartition(':')[-1]}"

    @property
    def _called(self):
        """What messages call the function."""
        return called_name(self.register)

    @cached_property
    def _told(self):
        """The failures that have been logged: each once, in however many settings it happens."""
        return set()

    def estimate(self, group: Group) -> Iterator[Samples | Covariance]:
        from icpshap import icp

        register = self.function()
        counts: Counter[str] = Counter()
        reference = icp.Reference(group.reference)

        def from_all(points, T_initial):
            end = called(register, group.reference, points, T_initial)
            return end.T_reference_source, end.status, 0

        for start in group.starts:
            if self.adds_closed_form:
                chain = icp.Chain(matches=1)
                yield from self.closed_forms(group, reference, [start], chain, from_all)
            ends = []
            for rows, T_initial in zip(start.rows, start.T_initial, strict=True):
                end = called(register, group.reference, start.source[rows], T_initial)
                if end.status != "ok" and end.status not in self._told:
                    self._told.add(end.status)
                    log.warning("%s %s", self._called, end.status, exc_info=end.error)
                counts[end.status] += 1
                # An error holds all that its call had, copies of the clouds among it.
                ends.append(end._replace(error=None))
            unknown = np.full(len(ends), np.nan)
            yield Samples(
                start.setting,
                group.noise_draw,
                group.runs,
                np.array([end.T_reference_source for end in ends]),
                start.initial_xi,
                np.zeros(len(ends), dtype=int),
                np.array([end.status for end in ends]),
                unknown,
                unknown,
            )
        number = counts.total()
        if failed := number - counts["ok"]:
            log.info("%s: %d of %d runs failed", self._called, failed, number)


class End(NamedTuple):
    """How a call ended: its pose (4, 4), its status, and the error that it raised, if any."""

    T_reference_source: np.ndarray
    status: str
    error: BaseException | None = None


def called(
    register: Callable, reference: np.ndarray, source: np.ndarray, T_initial: np.ndarray
) -> End:
    """`End` of one call on clouds (n, 3), (m, 3) [m] from the pose T_initial (4, 4).

    One that fails keeps its initial pose, and its status says why.
    Raises UserError for a module that is not installed, which no other call would find.
    """
    copies = [np.array(each, dtype=float, order="C") for each in (reference, source, T_initial)]
    try:
        returned = register(*copies)
    except MissingExtra:
        raise
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        raise UserError(
            f"{called_name(register)}: {missing or error} is not installed.\n"
            f"Hint: pip install {missing or 'what it imports'}"
        ) from error
    except (Exception, SystemExit) as error:
        return End(T_initial, f"raised {_said(error)}", error)
    if failure := no_pose(returned):
        return End(T_initial, failure)
    return End(np.array(returned, dtype=float), "ok")


def called_name(register: str | Callable) -> str:
    """What messages and tables call a function; the same in every process."""
    if isinstance(register, partial):
        return called_name(register.func)
    if isinstance(register, str):
        return register
    return getattr(register, "__name__", type(register).__name__)


def no_pose(returned: object) -> str:
    """Why what a function returned is no pose; "" if it is one."""
    try:
        T = np.asarray(returned, dtype=float)
    except (TypeError, ValueError):
        T = np.array(np.nan)
    if T.ndim == 0:
        return f"returned a {type(returned).__name__}, expected an array (4, 4)"
    if T.shape != (4, 4):
        return f"returned an array {T.shape}, expected (4, 4)"
    if not np.isfinite(T).all():
        return "returned entries that are not finite"
    if rigid.fault(T):
        return "returned a matrix that is no rigid transformation"
    return ""


def found(register: str) -> Callable:
    """The function that "module:function" names. Raises UserError if there is none."""
    module_name, _, name = register.partition(":")
    try:
        module = registry.imported(module_name)
    except ModuleNotFoundError as error:
        if error.name is None or not f"{module_name}.".startswith(f"{error.name}."):
            raise _not_imported(module_name, error) from error
        raise UserError(
            f"there is no module {error.name}.\n"
            f"Hint: put {error.name.replace('.', '/')}.py into the working directory, or install it"
        ) from error
    except (Exception, SystemExit) as error:
        raise _not_imported(module_name, error) from error
    if not hasattr(module, name):
        close = difflib.get_close_matches(name, vars(module), n=1)
        where = getattr(module, "__file__", None) or "a part of Python"
        raise UserError(
            f"the module {module_name} ({where}) has no function {name}"
            f"{f', did you mean {close[0]}?' if close else '.'}\n"
            "Hint: module:function names a function of the module itself"
        )
    function = getattr(module, name)
    if not callable(function):
        raise UserError(
            f"{register} is a {type(function).__name__}, expected a function.\n"
            "Hint: define it as `def register(reference, source, T_initial):`"
        )
    check_arguments(register, function)
    return function


def _not_imported(module_name, error):
    return UserError(
        f"importing {module_name} raised {_said(error)}.\n"
        f"Hint: python -c 'import {module_name}' shows where"
    )


def check_arguments(register: str, function: Callable) -> None:
    """Raise UserError if a function is known not to take three arguments; register: its name."""
    try:
        signature = inspect.signature(function)
    except ValueError:  # compiled functions do not always say
        return
    try:
        signature.bind("reference", "source", "T_initial")
    except TypeError:
        raise UserError(
            f"{register}{signature} does not take three arguments.\n"
            "Hint: it is called as function(reference, source, T_initial)"
        ) from None


def _said(error):
    """What an exception says, on one line; where things lie in memory differs from run to run."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    text = re.sub(r"\b0x[0-9a-fA-F]+", "0x...", text)
    return text.encode(errors="backslashreplace").decode()[:LONGEST].removesuffix(": ")
