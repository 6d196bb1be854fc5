"""What a result was made with: digests of code and data."""

import ast
import hashlib
import sys
from functools import cache
from pathlib import Path

from icpshap.causes import CAUSES
from icpshap.data.formats import READERS
from icpshap.estimators import KINDS

LIBRARY = Path(__file__).parent.parent
READ_AND_WRITE = ("tables.py", "errors.py", "jobs/logs.py", "jobs/digests.py")
# Packages of which a job uses only the modules that its plan names; of others it uses all.
CHOSEN = ("causes", "estimators", "formats")


def code_digest(script, plugins=()):
    """Digest of the library modules that a script imports, directly or through one another.

    plugins: the causes, estimators and readers of scan formats that it meets, found without being
    imported by name. Docstrings, comments and layout do not count, nor do the modules that only
    read and write, so that only a change of what is computed does. (`tables` refuses a file with
    other columns.)
    """
    files = [str(sys.modules[plugin.__module__].__file__) for plugin in plugins]
    return _digest(str(script), *sorted(set(files)))


@cache
def _digest(*files):
    script, *plugins = map(Path, files)
    seen = {script: True}
    _imported(script, seen)
    for path in plugins:
        seen[path] = True
        _imported(path, seen)
    digest = hashlib.sha256()
    for path in sorted(seen):
        # A plug-in of a user's own may lie elsewhere.
        inside = path.is_relative_to(LIBRARY)
        if inside and path.relative_to(LIBRARY).as_posix() in READ_AND_WRITE:
            continue
        digest.update(_code(path).encode())
    return digest.hexdigest()[:16]


def plugin_names(estimator):
    """The kind and the causes of an estimators.Estimator, as JSON can hold them; see `plugins`."""
    return {"kind": estimator.kind.name, "causes": list(estimator.causes)}


def plugins(names):
    """What has these names: the `kind`, the `causes` and the `format`, by its suffix."""
    found = [KINDS[names["kind"]]] if "kind" in names else []
    found += [CAUSES[name] for name in names.get("causes", ())]
    return found + ([READERS[names["format"]]] if "format" in names else [])


def sha256(path):
    """SHA256 of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def data_digests(*paths):
    """Digest of each file by its name."""
    return {Path(path).name: sha256(path)[:16] for path in paths}


def _code(path):
    """A module's code without docstrings, comments and layout."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and _has_docstring(node):
            node.body[0].value.value = ""
    return ast.unparse(tree)


def _imported(path, seen):
    """Paths of the library modules that a file imports, and of those that they import."""
    for module in _modules_of(path):
        if module not in seen:
            seen[module] = True
            _imported(module, seen)


def _modules_of(path):
    """Paths of the library modules that a file imports by name or finds in its own folder."""
    names = _imported_names(ast.parse(path.read_text(encoding="utf-8")))
    found = [module for name in names for module in _files(name)]
    finds_plugins = path.name == "__init__.py" and f"{LIBRARY.name}.registry" in names
    if finds_plugins and path.parent.name not in CHOSEN:
        found += sorted(path.parent.glob("*.py"))
    return found


def _imported_names(tree):
    names = []
    for node in ast.walk(tree):
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
