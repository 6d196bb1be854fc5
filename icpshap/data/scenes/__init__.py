"""Scenes of simulated scans: every module here is one, and is found by its name.

Such a module has

- ``build(open3d)``: the triangle meshes, made with the imported module open3d;
- ``PATH``: (k, 3) [m], corners of the curve along which the scanner travels, in the scene's frame,
  z up.

Nothing else has to know of a scene. A module whose name begins with ``_`` is a part of several.
"""

from icpshap import registry

SCENES = {
    module.__name__.rpartition(".")[2]: module for module in registry.modules(__name__, __path__)
}
