"""What a result was made with: digests of code and data."""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from icpshap import registry
from icpshap.causes import CAUSES
from icpshap.data.formats import READERS
from icpshap.estimators import KINDS

if TYPE_CHECKING:
    from icpshap.estimators import Estimator


LIBRARY = Path(__file__).resolve().parent.parent
READ_AND_WRITE = ("tables.py", "errors.py", "jobs/logs.py", "jobs/digests.py")
# Packages of which a job uses only the modules that its plan names; of others it uses all.
CHOSEN = ("causes", "estimators", "formats")


def code_digest(script: str | Path, plugins: Iterable[type | ModuleType] = ()) -> str:
    """Digest of the library modules that a script imports, directly or through one another.

    plugins: the causes, estimators and readers of scan formats that it meets, found without being
    imported by name, and modules of the user's own. Of these their file counts, and the version of
    each package that it imports or belongs to, but no other file. Docstrings, comments, types of
    functions and layout do not count, nor do the modules that only read and write, so that only a
    change of what is computed does. (`tables` refuses a file with other columns.)
    """
    own = [plugin for plugin in plugins if isinstance(plugin, ModuleType)]
    modules = {sys.modules[plugin.__module__] for plugin in plugins if plugin not in own}
    files = sorted(str(module.__file__) for module in modules)
    return _digest(str(script), *files, own=tuple(own))


@cache
def _digest(*files, own=()):
    # A path through `..` or a link would come elsewhere in the order below.
    script, *plugins = (Path(file).resolve() for file in files)
    seen = {script: True}
    _imported(script, seen)
    for path in plugins:
        seen[path] = True
        _imported(path, seen)
    digest = hashlib.sha256()
    for module in own:
        digest.update(repr(_versions(module)).encode())
        if (path := _file(module)).suffix == ".py":
            _imported(path, seen)
            digest.update(_code(_text(path)).encode())
        elif path.is_file():
            digest.update(path.read_bytes())
    for path in sorted(seen):
        # A plug-in of a user's own may lie elsewhere.
        inside = path.is_relative_to(LIBRARY)
        if inside and path.relative_to(LIBRARY).as_posix() in READ_AND_WRITE:
            continue
        digest.update(_code(_text(path)).encode())
    return digest.hexdigest()[:16]


def plugin_names(estimator: Estimator) -> dict[str, Any]:
    """What `plugins` finds those of an estimators.Estimator by, as JSON can hold it."""
    names = {"kind": estimator.kind.name, "causes": list(estimator.causes)}
    own = [module.__name__ for module in estimator.kind.modules]
    return names | ({"modules": own} if own else {})


def plugins(names: Mapping[str, Any]) -> list[type | ModuleType]:
    """What has these names: `kind` or `kinds`, `modules`, `causes`; `formats` by their suffixes."""
    found: list[type | ModuleType] = [KINDS[names["kind"]]] if "kind" in names else []
    found += [KINDS[name] for name in names.get("kinds", ())]
    found += [registry.imported(name) for name in names.get("modules", ())]
    found += [CAUSES[name] for name in names.get("causes", ())]
    return found + [READERS[suffix] for suffix in names.get("formats", ())]


def sha256(path: str | Path) -> str:
    """SHA256 of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _file(module):
    """Path of a module's file; the working directory for one that is compiled into Python."""
    return Path(getattr(module, "__file__", None) or "")


def _versions(module):
    """Versions by name of the packages that a user's module belongs to or imports, sorted.

    Through library modules too, such as the one that loads Open3D.
    """
    names = {module.__name__.split(".")[0]}
    path = _file(module)
    if path.suffix == ".py":
        seen = {path: True}
        _imported(path, seen)
        for file in seen:
            names |= _packages(ast.parse(_text(file)))
    known = metadata.packages_distributions()
    found = {}
    for distribution in {part for name in names for part in known.get(name, [name])}:
        # What belongs to no package: a user's file, a module of Python's own.
        with suppress(metadata.PackageNotFoundError):
            found[distribution] = metadata.version(distribution)
    return dict(sorted(found.items()))


def _packages(tree):
    """Names of the packages that code imports, wherever in it."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add((node.module or "").split(".")[0])
    return names


def _text(path):
    return path.read_text(encoding="utf-8")


@cache  # most modules are part of many digests, and parsing them is what a digest costs
def _code(text):
    """A module's code without docstrings, comments, types of functions and layout."""
    tree = _Computing().visit(ast.parse(text))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and _has_docstring(node):
            node.body[0] = ast.Expr(ast.Constant(""))
    return ast.unparse(tree)


class _Computing(ast.NodeTransformer):
    """A module without what is there for types alone. (Those of fields decide what options are.)"""

    def visit_If(self, node):
        named = isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        return None if named else self.generic_visit(node)

    def visit_ImportFrom(self, node):
        return None if node.module in ("__future__", "typing", "collections.abc") else node

    def visit_FunctionDef(self, node):
        node.returns = None
        return self.generic_visit(node)

    def visit_arg(self, node):
        node.annotation = None
        return node


def _imported(path, seen):
    """Paths of the library modules that a file imports, and of those that they import."""
    for module in _modules_of(path):
        if module not in seen:
            seen[module] = True
            _imported(module, seen)


def _modules_of(path):
    """Paths of the library modules that a file imports by name or finds in its own folder."""
    names = _imported_names(_text(path))
    found = [module for name in names for module in _files(name)]
    finds_plugins = path.name == "__init__.py" and f"{LIBRARY.name}.registry" in names
    if finds_plugins and path.parent.name not in CHOSEN:
        found += sorted(path.parent.glob("*.py"))
    return found


@cache
def _imported_names(text):
    """Dotted names of what a module's text imports of the library."""
    names = []
    for node in ast.walk(_Computing().visit(ast.parse(text))):
        if isinstance(node, ast.ImportFrom):
            names += [f"{node.module or ''}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
    return [name for name in names if name.split(".")[0] == LIBRARY.name]


def _files(name):
    """The files behind a dotted name: modules and packages on the way to it."""
    parts = name.split(".")
    for count in range(1, len(parts)):
        folder = LIBRARY.joinpath(*parts[1:count])
        for path in (
            folder.joinpath(parts[count]).with_suffix(".py"),
            folder / parts[count] / "__init__.py",
        ):
            if path.is_file():
                yield path


def _has_docstring(node):
    return ast.get_docstring(node, clean=False) is not None
