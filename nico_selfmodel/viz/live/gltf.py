"""Triangles as a glTF file that needs no other, for Drake's Meshcat; and files as addresses."""

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

_FLOAT, _UNSIGNED_INT = 5126, 5125
"""Component types of glTF."""
_KINDS = {2: "VEC2", 3: "VEC3"}


def gltf_text(
    vertices: NDArray,
    attributes: Mapping[str, NDArray],
    triangles: NDArray,
    material: Mapping[str, Any],
    more: Mapping[str, Any] | None = None,
) -> str:
    """Return triangles as a glTF.

    Args:
        vertices: z up, as Drake has them [m]. Shape (V, 3).
        attributes: Of the vertices, by glTF's names; `NORMAL` with z up too. (V, 2 or 3) each.
        triangles: Numbers of vertices. Shape (T, 3).
        material: Of glTF.
        more: Further entries of the document.
    """
    given = {"POSITION": vertices, **attributes}
    columns = {
        name: (_y_up(values) if name in ("POSITION", "NORMAL") else values).astype("<f4")
        for name, values in given.items()
    }
    place = columns["POSITION"]
    limits = {"min": place.min(axis=0).tolist(), "max": place.max(axis=0).tolist()}
    parts = [*columns.values(), np.ravel(triangles).astype("<u4")]
    offsets = np.cumsum([0, *(part.nbytes for part in parts)]).tolist()
    content = b"".join(part.tobytes() for part in parts)
    accessors = [
        _accessor(view, _FLOAT, len(values), _KINDS[values.shape[1]])
        for view, values in enumerate(columns.values())
    ]
    accessors[0] |= limits
    accessors.append(_accessor(len(columns), _UNSIGNED_INT, len(parts[-1]), "SCALAR"))
    primitive = {
        "attributes": {name: view for view, name in enumerate(columns)},
        "indices": len(columns),
        "material": 0,
    }
    document = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "buffers": [
            {"byteLength": offsets[-1], "uri": data_uri("application/octet-stream", content)}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": part.nbytes}
            for offset, part in zip(offsets, parts, strict=False)
        ],
        "accessors": accessors,
    }
    return json.dumps({**document, **(more or {})})


def data_uri(kind: str, content: bytes) -> str:
    """Return a file as an address that holds it."""
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _y_up(p: NDArray) -> NDArray:
    """Return points as glTF has them, with y up; Drake turns them back. Shape (N, 3)."""
    x, y, z = np.asarray(p, dtype=float).T
    return np.stack([x, z, -y], axis=1)


def _accessor(view: int, component: int, count: int, kind: str) -> dict[str, Any]:
    return {"bufferView": view, "componentType": component, "count": count, "type": kind}
