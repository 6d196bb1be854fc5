"""The digest of the code that a rule runs through."""

import sys
from types import ModuleType

import pytest
from conftest import REPOSITORY

from icpshap.estimators import Estimator
from icpshap.jobs import digests


@pytest.fixture
def library(tmp_path, monkeypatch):
    root = tmp_path / "icpshap"
    for folder in ("icp", "formats", "causes"):
        (root / folder).mkdir(parents=True)
    files = {
        "__init__.py": "",
        "a.py": '"""Doc."""\nfrom icpshap import b\n\n\ndef f():\n    """Doc."""\n    return b.x\n',
        "b.py": "x = 1\n",
        "c.py": "y = 2\n",
        "icp/__init__.py": "from icpshap.icp.d import z\n",
        "icp/d.py": "z = 3\n",
        "registry.py": "r = 4\n",
        "formats/__init__.py": "from icpshap import registry\n",
        "formats/ply.py": "f = 5\n",
        "causes/__init__.py": "from icpshap import registry\n",
        "causes/noise.py": "from icpshap import c\nn = 6\n",
        "causes/pose.py": "p = 7\n",
    }
    for name, text in files.items():
        (root / name).write_text(text)
    monkeypatch.setattr(digests, "LIBRARY", root)
    digests._digest.cache_clear()
    script = tmp_path / "script.py"
    script.write_text("import numpy\nfrom icpshap import a, causes, formats, icp\n")
    return root, script


def change(path, old, new):
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    digests._digest.cache_clear()


@pytest.fixture
def noise(library, monkeypatch):
    """A class as a plug-in of the package of causes defines it."""
    root, _ = library
    module = ModuleType("icpshap.causes.noise")
    module.__file__ = str(root / "causes" / "noise.py")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return type("Noise", (), {"__module__": module.__name__})


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("a.py", "b.x", "b.x + 1"),
        ("b.py", "1", "2"),
        ("icp/d.py", "3", "4"),
    ],
)
def test_a_module_that_the_script_reaches_changes_it(library, name, old, new):
    root, script = library
    before = digests.code_digest(script)
    change(root / name, old, new)
    assert digests.code_digest(script) != before


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("c.py", "2", "5"),
        ("a.py", "Doc.", "Another sentence."),
        ("b.py", "x = 1", "# why\nx = 1"),
        ("a.py", "def f():", "def f() -> int:"),
        (
            "b.py",
            "x = 1",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from icpshap import c\nx = 1",
        ),
        ("formats/ply.py", "5", "6"),
        ("causes/noise.py", "6", "8"),
        ("causes/pose.py", "7", "8"),
    ],
)
def test_what_it_does_not_reach_and_words_do_not(library, name, old, new):
    root, script = library
    before = digests.code_digest(script)
    change(root / name, old, new)
    assert digests.code_digest(script) == before


@pytest.mark.parametrize(
    ("name", "changes"), [("causes/noise.py", True), ("c.py", True), ("causes/pose.py", False)]
)
def test_of_causes_and_estimators_only_those_that_are_used_count(library, noise, name, changes):
    root, script = library
    before = digests.code_digest(script, [noise])
    assert before != digests.code_digest(script)
    change(root / name, "= ", "= 1 + ")
    assert (digests.code_digest(script, [noise]) != before) == changes


def test_the_order_of_what_is_used_does_not_matter(library, noise):
    _, script = library
    assert digests.code_digest(script, [noise, noise]) == digests.code_digest(script, {noise})


def test_no_module_of_the_registration_is_missed():
    """What is found in a folder is no import: the digest must know of it all the same."""
    seen = {}
    digests._imported(REPOSITORY / "workflow" / "scripts" / "run_icp.py", seen)
    reached = {path.relative_to(digests.LIBRARY).as_posix() for path in seen}
    assert {"estimators/perturb.py", "causes/cause.py", "se3.py", "plan.py"} <= reached
    # The kind and the causes come by name, and with them what they import.
    assert not {"estimators/monte_carlo.py", "causes/sensor_noise.py"} & reached
    plugins = Estimator.of("monte_carlo", {}).of_causes(["sensor_noise"]).plugins
    assert [plugin.__name__ for plugin in plugins] == ["MonteCarlo", "SensorNoise"]


@pytest.mark.parametrize("script", ["run_icp", "check_pairs", "join_pairs", "find_instances"])
def test_what_shows_and_diagnoses_is_no_part_of_what_registers(script):
    """Else an edited diagnosis, report or time limit would register every pair again."""
    seen = {}
    digests._imported(REPOSITORY / "workflow" / "scripts" / f"{script}.py", seen)
    reached = {path.relative_to(digests.LIBRARY).as_posix() for path in seen if path.stem != script}
    others = {"report", "jobs/few.py", "jobs/time_limits.py", "explanation/games.py"}
    if script != "find_instances":
        others.add("diagnosis")
    assert not {path for path in reached if path.startswith(tuple(others))}
