"""Every public function and method of the library says the types of what it takes and returns."""

import ast
from pathlib import Path

import pytest

import icpshap

PACKAGE = Path(icpshap.__file__).parent


def is_public(path):
    """Whether no name on the way to a module begins with _, but those as `__init__`."""
    names = path.relative_to(PACKAGE).with_suffix("").parts
    return all(name.startswith("__") or not name.startswith("_") for name in names)


def public(node, where=""):
    """(name, function, whether it is a method) of what stands in a module or a public class."""
    for part in ast.iter_child_nodes(node):
        if isinstance(part, ast.ClassDef) and not part.name.startswith("_"):
            yield from public(part, f"{part.name}.")
        elif isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef):
            special = part.name.startswith("__") and part.name.endswith("__")
            if special or not part.name.startswith("_"):
                yield where + part.name, part, bool(where)
        elif isinstance(part, ast.If | ast.Try | ast.With):
            yield from public(part, where)


def untyped(function, is_method):
    """What of a function has no type: names of arguments, and `return`."""
    arguments = function.args
    named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    named += [extra for extra in (arguments.vararg, arguments.kwarg) if extra]
    static = any(getattr(mark, "id", "") == "staticmethod" for mark in function.decorator_list)
    if is_method and not static:
        named = named[1:]
    missing = [argument.arg for argument in named if argument.annotation is None]
    return missing + ["return"] * (function.returns is None)


def missing_in(source):
    """'name (arguments)' of each public function of a module's text that is not fully typed."""
    return [
        f"{name} ({', '.join(missing)})"
        for name, function, is_method in public(ast.parse(source))
        if (missing := untyped(function, is_method))
    ]


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(PACKAGE.rglob("*.py")) if is_public(path)],
    ids=lambda path: path.relative_to(PACKAGE).as_posix(),
)
def test_public_functions_are_typed(path):
    assert missing_in(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("source", "missing"),
    [
        ("def f(a: int, *b: int, c: int = 1, **d: int) -> int: ...", []),
        ("def f(a, *b, c=1, **d): ...", ["f (a, c, b, d, return)"]),
        ("class C:\n    def f(self, a: int): ...", ["C.f (return)"]),
        ("class C:\n    def __init__(self, a) -> None: ...", ["C.__init__ (a)"]),
        ("class C:\n    @staticmethod\n    def f(a) -> None: ...", ["C.f (a)"]),
        ("def _f(a): ...\nclass _C:\n    def f(self): ...", []),
        ("if True:\n    def f(a) -> int: ...", ["f (a)"]),
    ],
)
def test_what_is_missing_is_named(source, missing):
    assert missing_in(source) == missing
