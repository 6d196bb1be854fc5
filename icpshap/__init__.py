"""icpshap: why is this point cloud registration uncertain?"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from icpshap.explanation.games import load_explanation
    from icpshap.one_pair.covariance import PoseCovariance
    from icpshap.one_pair.diagnosis import Diagnosis, diagnose
    from icpshap.one_pair.explanation import Explanation
    from icpshap.one_pair.given import read_scan
    from icpshap.one_pair.recipe import explain, fit_table
    from icpshap.presets import LIDAR, PAPER, RELEASED_CODE, ROBUST

# Where each public name lives; it is imported when it is used, since some of them take a second.
_HOMES = {
    "LIDAR": "icpshap.presets",
    "PAPER": "icpshap.presets",
    "RELEASED_CODE": "icpshap.presets",
    "ROBUST": "icpshap.presets",
    "Diagnosis": "icpshap.one_pair.diagnosis",
    "Explanation": "icpshap.one_pair.explanation",
    "PoseCovariance": "icpshap.one_pair.covariance",
    "diagnose": "icpshap.one_pair.diagnosis",
    "explain": "icpshap.one_pair.recipe",
    "fit_table": "icpshap.one_pair.recipe",
    "load_explanation": "icpshap.explanation.games",
    "read_scan": "icpshap.one_pair.given",
}
__all__ = [
    "LIDAR",
    "PAPER",
    "RELEASED_CODE",
    "ROBUST",
    "Diagnosis",
    "Explanation",
    "PoseCovariance",
    "diagnose",
    "explain",
    "fit_table",
    "load_explanation",
    "read_scan",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return __all__
