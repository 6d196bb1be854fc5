"""Plug-ins: packages whose modules are found by being there; to add one is to add a file."""

import importlib
import os
import pkgutil
import sys
from collections.abc import Iterable
from types import ModuleType
from typing import ClassVar, Protocol, TypeVar


class Named(Protocol):
    """What has a name by which it is found."""

    name: ClassVar[str]


Plugin = TypeVar("Plugin", bound=Named)


def modules(package: str, path: Iterable[str]) -> list[ModuleType]:
    """The modules of a package, by name; those whose name begins with _ are parts of others.

    package: its dotted name; path: its ``__path__``.
    """
    names = sorted(module.name for module in pkgutil.iter_modules(path))
    return [importlib.import_module(f"{package}.{name}") for name in names if name[0] != "_"]


def imported(name: str) -> ModuleType:
    """The module of that dotted name, be it installed or a file of the working directory.

    The working directory comes last: a file in it hides no library.
    """
    if os.getcwd() not in sys.path:
        sys.path.append(os.getcwd())
        importlib.invalidate_caches()
    return importlib.import_module(name)


def classes(package: str, path: Iterable[str], base: type[Plugin]) -> dict[str, type[Plugin]]:
    """The subclasses of `base` that the modules of a package define, by their `name`.

    Raises ImportError if two have the same name.
    """
    found: dict[str, type[Plugin]] = {}
    for module in modules(package, path):
        for member in vars(module).values():
            if not (isinstance(member, type) and issubclass(member, base)):
                continue
            if member is base or member.__module__ != module.__name__:
                continue
            if member.name in found:
                raise ImportError(
                    f"{module.__file__}: the name {member.name!r} is taken by "
                    f"{found[member.name].__module__}.\nHint: give each its own."
                )
            found[member.name] = member
    return found
