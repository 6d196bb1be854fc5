"""icpshap: why is this point cloud registration uncertain?"""

from importlib import import_module

# Where each public name lives; it is imported when it is used, since some of them take a second.
_HOMES = {
    "LIDAR": "icpshap.presets",
    "PAPER": "icpshap.presets",
    "RELEASED_CODE": "icpshap.presets",
    "ROBUST": "icpshap.presets",
    "load_explanation": "icpshap.explanation.games",
}
__all__ = sorted(_HOMES)


def __getattr__(name):
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__():
    return __all__
