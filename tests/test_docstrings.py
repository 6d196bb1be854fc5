"""Examples of docstrings do what they say."""

import doctest
import importlib
import pkgutil

import pytest

import icpshap

FEWEST = 40  # examples: those of the door, and of what is easier shown than told


def modules():
    found = pkgutil.walk_packages(icpshap.__path__, "icpshap.")
    return ["icpshap", *(module.name for module in found if not module.name.endswith("__main__"))]


def examples():
    """The docstrings of all modules that have examples."""
    finder = doctest.DocTestFinder(exclude_empty=True)
    return [
        found
        for name in modules()
        for found in finder.find(importlib.import_module(name))
        if found.examples
    ]


EXAMPLES = examples()


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
def test_example(example):
    said = []
    runner = doctest.DocTestRunner(verbose=False)
    runner.run(example, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)


def test_there_are_examples():
    assert len(EXAMPLES) >= FEWEST
    names = {example.name.rpartition(".")[2] for example in EXAMPLES}
    assert {"explain", "diagnose", "fit_table", "read_scan"} <= names
