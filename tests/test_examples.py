"""The notebooks run, and hold nothing of the machine that they were made on."""

import re

import matplotlib
import nbformat
import pytest
from conftest import REPOSITORY

NOTEBOOKS = sorted((REPOSITORY / "examples").glob("*.ipynb"))


@pytest.fixture(params=NOTEBOOKS, ids=lambda path: path.stem)
def path(request):
    return request.param


def test_there_are_notebooks():
    assert len(NOTEBOOKS) == 3


def test_a_notebook_is_small_and_of_no_machine(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert len(notebook.cells) < 15
    assert path.stat().st_size < 300_000
    assert not re.search(r"/(home|root|tmp|work|usr|opt|Users)/|[A-Z]:\\\\", path.read_text())
    assert all(not cell.metadata for cell in notebook.cells)


def test_outputs_are_stored_and_are_no_errors(path):
    outputs = [
        output for cell in code_cells(path) for output in cell.outputs if cell.execution_count
    ]
    assert {output.output_type for output in outputs} <= {"execute_result", "stream"}
    assert all(output.get("name") != "stderr" for output in outputs)
    assert any("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.slow
def test_the_cells_run(path, monkeypatch, tmp_path):
    pytest.importorskip("small_gicp")
    pytest.importorskip("shapiq")
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    namespace = {"__name__": "__main__"}
    for number, cell in enumerate(code_cells(path)):
        exec(compile(cell.source, f"{path.name}, code cell {number}", "exec"), namespace)


def code_cells(path):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
