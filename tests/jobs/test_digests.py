"""The digest of the code that a rule runs through."""

import pytest

from icpshap.jobs import digests as provenance


@pytest.fixture
def library(tmp_path, monkeypatch):
    root = tmp_path / "icpshap"
    (root / "icp").mkdir(parents=True)
    files = {
        "__init__.py": "",
        "a.py": '"""Doc."""\nfrom icpshap import b\n\n\ndef f():\n    """Doc."""\n    return b.x\n',
        "b.py": "x = 1\n",
        "c.py": "y = 2\n",
        "icp/__init__.py": "from icpshap.icp.d import z\n",
        "icp/d.py": "z = 3\n",
    }
    for name, text in files.items():
        (root / name).write_text(text)
    monkeypatch.setattr(provenance, "LIBRARY", root)
    script = tmp_path / "script.py"
    script.write_text("import numpy\nfrom icpshap import a, icp\n")
    return root, script


def change(path, old, new):
    path.write_text(path.read_text().replace(old, new))


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
    before = provenance.code_digest(script)
    change(root / name, old, new)
    assert provenance.code_digest(script) != before


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("c.py", "2", "5"),
        ("a.py", "Doc.", "Another sentence."),
        ("b.py", "x = 1", "# why\nx = 1"),
    ],
)
def test_what_it_does_not_reach_and_words_do_not(library, name, old, new):
    root, script = library
    before = provenance.code_digest(script)
    change(root / name, old, new)
    assert provenance.code_digest(script) == before
