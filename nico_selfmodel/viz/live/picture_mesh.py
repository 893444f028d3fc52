"""A picture as either viewer takes it: a rectangle of two triangles with a texture, unlit."""

from typing import Any

import numpy as np

from nico_selfmodel.viz.live.gltf import data_uri, gltf_text
from nico_selfmodel.viz.scene.scene_items import Picture

_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
_TEXTURE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
"""Right and down in the image, of the corners in the order of `Picture.corners`."""


def picture_gltf(picture: Picture) -> str:
    """Return a picture as a glTF file that needs no other, for Drake."""
    opacity = picture.color[3]
    material = {
        "extensions": {"KHR_materials_unlit": {}},
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0},
            "baseColorFactor": [1.0, 1.0, 1.0, opacity],
        },
        "doubleSided": True,
        "alphaMode": "BLEND" if picture.image_kind == "image/png" or opacity < 1.0 else "OPAQUE",
    }
    more = {
        "extensionsUsed": ["KHR_materials_unlit"],
        "textures": [{"source": 0}],
        "images": [{"uri": data_uri(picture.image_kind, picture.image)}],
    }
    return gltf_text(picture.corners, {"TEXCOORD_0": _TEXTURE}, _TRIANGLES, material, more)


def picture_object(picture: Picture) -> Any:
    """Return a picture as an object of PyPI's meshcat, whose meshes know no textures."""
    import meshcat.geometry as shapes

    class Rectangle(shapes.TriangularMeshGeometry):
        def lower(self, object_data: Any) -> dict[str, Any]:
            data = super().lower(object_data)
            # three.js counts the rows of a texture from below.
            uv = np.column_stack([_TEXTURE[:, 0], 1.0 - _TEXTURE[:, 1]]).astype(np.float32)
            data["data"]["attributes"]["uv"] = shapes.pack_numpy_array(uv.T)
            return data

    class File(shapes.Image):
        def lower(self, object_data: Any) -> dict[str, Any]:
            return {"uuid": self.uuid, "url": data_uri(picture.image_kind, picture.image)}

    opacity = picture.color[3]
    material = shapes.MeshBasicMaterial(
        map=shapes.ImageTexture(image=File()),
        opacity=opacity,
        transparent=picture.image_kind == "image/png" or opacity < 1.0,
    )
    return shapes.Mesh(Rectangle(picture.corners, _TRIANGLES), material)
