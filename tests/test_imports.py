"""Modules import only what stands above them: the order of docs/extending.md, held.

And the tree of CONTRIBUTING.md is that of the repository.
"""

import ast
import re
from pathlib import Path

import icpshap

PACKAGE = Path(icpshap.__file__).parent
PAGE = PACKAGE.parent / "docs" / "extending.md"
DOOR = ("__init__", "__main__", "cli")  # what users open; it may import everything


def order():
    """Place of each module and package in the order, the topmost 0."""
    page = PAGE.read_text(encoding="utf-8")
    listed = re.search(r"Modules import only what stands above them: (.*?)\. A change", page, re.S)
    rows = [re.findall(r"`(\w+)/?`", row) for row in listed[1].split(";")]
    return {name: place for place, row in enumerate(rows) for name in row}


def imported(path):
    """Modules and packages of icpshap that a file imports, at its head or in a function."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: a relative import"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:
            package, *rest = name.split(".")
            if package == "icpshap" and rest[0] != "__version__":
                yield rest[0], node.lineno


def test_arrows_go_one_way():
    places = order()
    wrong, seen = [], set()
    for path in sorted(PACKAGE.rglob("*.py")):
        own = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if own in DOOR:
            continue
        seen.add(own)
        for name, line in imported(path):
            if name != own and places[name] > places[own]:
                wrong.append(f"{path.relative_to(PACKAGE)}:{line} imports {name}")
    assert wrong == []
    assert seen == set(places)  # the order has every module, and no other


def listed():
    """Paths of the tree of CONTRIBUTING.md: names at the head of its lines, below their folders."""
    page = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    folder = ""
    for line in re.search(r"```\n(Snakefile .*?)```", page, re.S)[1].splitlines():
        name = line.split()[0]
        folder = folder if line.startswith(" ") else ""
        yield folder + name
        folder = folder or name


def test_the_tree_is_that_of_the_repository():
    paths = list(listed())
    assert [path for path in paths if not (PACKAGE.parent / path).exists()] == []
    packages = {f"icpshap/{path.parent.name}/" for path in PACKAGE.glob("*/__init__.py")}
    assert packages == {
        path for path in paths if path.startswith("icpshap/") and path != "icpshap/"
    }
