"""Import Open3D also where libusb-1.0.so.0 is missing (bare Debian): its library is preloaded."""

import ctypes
from types import ModuleType

from icpshap.errors import extra


def load_open3d() -> ModuleType:
    """The `open3d` module. Takes about a second, so call it only where Open3D is needed.

    Raises MissingExtra where it is not installed.
    """
    with extra("formats", "libusb_package", "open3d"):
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import open3d

    return open3d
