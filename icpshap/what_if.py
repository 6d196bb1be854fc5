"""What if: the explained instance of an experiment run again with other options.

`what_if: {name: changes}` of an experiment makes, of each name, an experiment <experiment>_<name>
with the instance alone, and an estimator of the same name that is based on the experiment's own.
Changes are options of the estimator, and levels of causes that the experiment names.
"""

from collections.abc import Mapping
from typing import Any

from icpshap.causes import CAUSES


def levels_of(changes: Mapping[str, Any]) -> dict[str, float]:
    """Levels of causes among changes.

    >>> changes = {"sensor_noise": 0.05, "normal_neighbours": 20}
    >>> levels_of(changes), options_of(changes)
    ({'sensor_noise': 0.05}, {'normal_neighbours': 20})
    """
    return {name: value for name, value in changes.items() if name in CAUSES}


def options_of(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Options of the estimator among changes."""
    return {name: value for name, value in changes.items() if name not in CAUSES}


def parts(experiment: str, block: Mapping[str, Any]) -> dict[str, str]:
    """Names of the experiments that `what_if` makes, by the name of the change."""
    return {name: f"{experiment}_{name}" for name in block.get("what_if") or {}}


def explained(block: Mapping[str, Any]) -> dict[str, float] | None:
    """The instance that is explained: that of the waterfall plot, or the fixed one; or None."""
    return block.get("waterfall") or block["instances"].get("fixed")


def experiments(experiment: str, block: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Blocks of the experiments that `what_if` makes, by their name."""
    kept = ("pairs", "sequences", "replicates")
    return {
        part: {
            **{key: block[key] for key in kept if key in block},
            "estimator": part,
            "instances": {
                "fixed": {**(explained(block) or {}), **levels_of(block["what_if"][name])}
            },
            "figures": [],
        }
        for name, part in parts(experiment, block).items()
    }


def estimators(experiment: str, block: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Blocks of the estimators that `what_if` makes, by their name.

    For a block that nobody has checked: what is none is left out.
    """
    changes = block.get("what_if")
    if not isinstance(changes, dict) or not isinstance(block.get("estimator"), str):
        return {}
    return {
        f"{experiment}_{name}": {"based_on": block["estimator"], **options_of(change)}
        for name, change in changes.items()
        if isinstance(change, dict)
    }
