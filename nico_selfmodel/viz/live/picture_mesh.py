"""A picture as either viewer takes it: a rectangle of two triangles with a texture, unlit."""

import base64
import json
from typing import Any

import numpy as np

from nico_selfmodel.viz.scene.scene_items import Picture

_TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
_TEXTURE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
"""Right and down in the image, of the corners in the order of `Picture.corners`."""
_FLOAT, _UNSIGNED_SHORT = 5126, 5123
"""Component types of glTF."""


def picture_gltf(picture: Picture) -> str:
    """Return a picture as a glTF file that needs no other, for Drake.

    glTF has y up, and Drake turns it so that z is: (x, y, z) becomes (x, -z, y).
    """
    x, y, z = picture.corners.T
    corners = np.stack([x, z, -y], axis=1).astype("<f4")
    parts = [corners, _TEXTURE.astype("<f4"), _TRIANGLES.astype("<u2").ravel()]
    offsets = np.cumsum([0, *(part.nbytes for part in parts)]).tolist()
    limits = {"min": corners.min(axis=0).tolist(), "max": corners.max(axis=0).tolist()}
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
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [_PRIMITIVE]}],
        "materials": [material],
        "textures": [{"source": 0}],
        "images": [{"uri": data_uri(picture.image_kind, picture.image)}],
        "buffers": [
            {
                "byteLength": offsets[-1],
                "uri": data_uri(
                    "application/octet-stream", b"".join(part.tobytes() for part in parts)
                ),
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": part.nbytes}
            for offset, part in zip(offsets, parts, strict=False)
        ],
        "accessors": [
            _accessor(0, _FLOAT, 4, "VEC3") | limits,
            _accessor(1, _FLOAT, 4, "VEC2"),
            _accessor(2, _UNSIGNED_SHORT, 6, "SCALAR"),
        ],
    }
    return json.dumps(document)


_PRIMITIVE = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}


def _accessor(view: int, component: int, count: int, kind: str) -> dict[str, Any]:
    return {"bufferView": view, "componentType": component, "count": count, "type": kind}


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


def data_uri(kind: str, content: bytes) -> str:
    """Return a file as an address that holds it.

    Args:
        kind: Its MIME type.
        content: The file.
    """
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
