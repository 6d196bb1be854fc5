"""What a result was made with: digests of code and data."""

import ast
import hashlib
from pathlib import Path

LIBRARY = Path(__file__).parent.parent
READ_AND_WRITE = ("tables.py", "errors.py", "jobs/logs.py", "jobs/digests.py")


def code_digest(script):
    """Digest of the library modules that a script imports, directly or through one another.

    Docstrings, comments and layout do not count, nor do the modules that only read and write, so
    that only a change of what is computed does. (`tables` refuses a file with other columns.)
    """
    digest = hashlib.sha256()
    for path in sorted(_imported(Path(script), {})):
        if path.relative_to(LIBRARY).as_posix() in READ_AND_WRITE:
            continue
        tree = ast.parse(path.read_text())
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and _has_docstring(
                node
            ):
                node.body[0].value.value = ""
        digest.update(ast.unparse(tree).encode())
    return digest.hexdigest()[:16]


def file_digest(path):
    """Digest of a file's bytes."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()[:16]


def _imported(path, seen):
    """Paths of the library modules that a file imports, and of those that they import."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == LIBRARY.name:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            continue
        for name in names:
            for module in _files(name):
                if module not in seen:
                    seen[module] = True
                    _imported(module, seen)
    return seen


def _files(name):
    """The files behind a dotted name: modules and packages on the way to it."""
    parts = name.split(".")
    if parts[0] != LIBRARY.name:
        return
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
