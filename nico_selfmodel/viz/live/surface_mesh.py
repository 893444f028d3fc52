"""A surface in many colours as Drake's Meshcat takes it: shaded smoothly, seen from both sides."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.triangle_mesh import TriangleMesh
from nico_selfmodel.viz.live.gltf import gltf_text
from nico_selfmodel.viz.scene.scene_items import Surface


def surface_gltf(surface: Surface, colors: NDArray) -> str:
    """Return a surface as a glTF file that needs no other.

    Args:
        colors: Red, green and blue of each vertex, as a screen shows them. Shape (v, 3).
    """
    opacity = surface.color[3]
    material = {
        "pbrMetallicRoughness": {
            "baseColorFactor": [1.0, 1.0, 1.0, opacity],
            "metallicFactor": 0.0,
            "roughnessFactor": 0.9,
        },
        "doubleSided": True,
        "alphaMode": "BLEND" if opacity < 1.0 else "OPAQUE",
    }
    normals = TriangleMesh(surface.vertices, surface.faces).normals
    normals = np.where(np.any(normals, axis=1, keepdims=True), normals, [0.0, 0.0, 1.0])
    attributes = {"NORMAL": normals, "COLOR_0": _linear(colors)}
    return gltf_text(surface.vertices, attributes, surface.faces, material)


def _linear(colors: NDArray) -> NDArray:
    """Return light in proportion, which glTF has, of what a screen is told (sRGB)."""
    return np.where(colors <= 0.04045, colors / 12.92, ((colors + 0.055) / 1.055) ** 2.4)
