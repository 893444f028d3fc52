"""A scene as one page of Drake's viewer: its files lie in Drake's package, which is not loaded."""

import base64
import json
import re
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.viz.live.meshing import mesh_of
from nico_selfmodel.viz.live.paint import AMBIENT, BACKGROUND, paint
from nico_selfmodel.viz.live.picture_mesh import picture_gltf
from nico_selfmodel.viz.live.surface_mesh import surface_gltf
from nico_selfmodel.viz.scene.scene import FIELD_OF_VIEW, ROOT, Scene
from nico_selfmodel.viz.scene.scene_items import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Item,
    Picture,
    Segments,
    Surface,
)

_GRAIN = 2.0**-15
"""To which places of triangles are rounded, for pages to be packed: nobody sees it [m]."""
_DECODERS = re.compile(r"data:application/(?:wasm|javascript);base64,[\w+/=]*")
"""What the viewer reads compressed meshes and textures with, most of its page: ours are plain."""
_VIEWER = '<script type="text/javascript" src="meshcat.js"></script>'
_BEGIN, _END = "<!-- CONNECTION BLOCK BEGIN -->", "<!-- CONNECTION BLOCK END -->"
"""What Drake's page has for a server: commands stand in its place."""
_DRAW = """
function draw(command) {
  const bytes = text => Uint8Array.from(atob(text), letter => letter.charCodeAt(0)).buffer;
  for (const {data} of command.object?.geometries ?? [])
    for (const one of [data?.index, ...Object.values(data?.attributes ?? {})])
      if (one) one.array = new globalThis[one.type](bytes(one.array));
  viewer.handle_command(command);
}
"""
# three.js cylinders and capsules lie along y, ours along z: by columns.
_Z_FROM_Y = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
_BOTH_SIDES = 2


def static_html(scene: Scene) -> str:
    """Return a scene as one page that needs no network and no server.

    Raises:
        SelfModelError: If Drake's page is another than the one that is known.
    """
    page, script = _of_drake("meshcat.html"), _of_drake("meshcat.js")
    before, begins, rest = page.partition(_BEGIN)
    _, ends, after = rest.partition(_END)
    if not (begins and ends and _VIEWER in before):
        raise SelfModelError(
            "Drake's meshcat.html has no place for commands where it is looked for: install an "
            "older Drake or a newer nico-selfmodel, or leave out the report (--no-report)"
        )
    before = before.replace(_VIEWER, f"<script>{_DECODERS.sub('data:,', script)}</script>")
    drawn = (json.dumps(command).replace("</", "<\\/") for command in _commands(scene))
    return "".join([before, _DRAW, *(f"draw({command});\n" for command in drawn), after])


def _of_drake(name: str) -> str:
    """Return a file of Drake's viewer, in the wheel or wherever else Drake has its files."""
    package = find_spec("pydrake")
    assert package is not None
    assert package.origin is not None
    path = Path(package.origin).parent / "share" / "drake" / "geometry" / name
    if not path.is_file():
        from pydrake.common import FindResourceOrThrow

        path = Path(FindResourceOrThrow(f"drake/geometry/{name}"))
    return path.read_text(encoding="utf-8")


def _commands(scene: Scene) -> Iterator[dict[str, Any]]:
    """Yield the viewer's commands."""
    for path in ("/Grid", "/Axes"):
        yield _property(path, "visible", False)
    for key, color in BACKGROUND.items():
        yield _property("/Background/<object>", key, list(color))
    yield _property("/Lights/AmbientLight/<object>", "intensity", AMBIENT)
    # Of see-through items of one place the last drawn wins: by path, as Drake's server sends them.
    for number, item in enumerate(sorted(scene.items, key=lambda one: one.path)):
        path = f"{ROOT}/{item.path}"
        yield {"type": "set_object", "path": path, "object": _object(item, str(number))}
        if not np.array_equal(item.X_WI, np.eye(4)):
            matrix = item.X_WI.T.ravel().tolist()
            yield {"type": "set_transform", "path": path, "matrix": matrix}
    camera = {"type": "PerspectiveCamera", "fov": float(np.degrees(FIELD_OF_VIEW))}
    camera |= {"aspect": 1.0, "near": 0.01, "far": 100.0, "zoom": 1.0}
    rig = "/Cameras/default/rotated"
    yield {"type": "set_object", "path": rig, "object": {"object": camera}}
    yield _property(f"{rig}/<object>", "position", _y_up(scene.camera.p_WC))
    yield {"type": "set_target", "value": _y_up(scene.camera.p_WT)}


def _property(path: str, name: str, value: Any) -> dict[str, Any]:
    return {"type": "set_property", "path": path, "property": name, "value": value}


def _y_up(p: NDArray) -> list[float]:
    x, y, z = p.tolist()
    return [x, z, -y]


def _object(item: Item, name: str) -> dict[str, Any]:
    """Return an item without its pose as three.js reads it, by a name of its own."""
    if isinstance(item, Picture):
        return _file(picture_gltf(item), name)
    if isinstance(item, Surface) and item.colors is not None:
        return _file(surface_gltf(item, item.colors), name)
    geometry, matrix = _geometry(item)
    kind, look = "Mesh", paint(item.color)
    material = {**look, "type": "MeshPhongMaterial", "side": _BOTH_SIDES}
    material["transparent"] = item.color[3] < 1.0
    if isinstance(item, Segments):
        kind, material = "LineSegments", {"type": "LineBasicMaterial", "color": look["color"]}
    elif geometry["type"] == "BufferGeometry":
        material["flatShading"] = True
        if "color" in geometry["data"]["attributes"]:
            material |= {"vertexColors": True, "color": 0xE5E5E5}
    g, m = f"geometry {name}", f"material {name}"
    drawn = {"uuid": name, "type": kind, "geometry": g, "material": m, "matrix": matrix}
    geometries, materials = [{"uuid": g, **geometry}], [{"uuid": m, **material}]
    return _document(drawn) | {"geometries": geometries, "materials": materials}


def _document(drawn: dict[str, Any]) -> dict[str, Any]:
    return {"metadata": {"version": 4.5, "type": "Object"}, "object": drawn}


def _file(gltf: str, name: str) -> dict[str, Any]:
    drawn = {"uuid": name, "type": "_meshfile_object", "format": "gltf", "data": gltf}
    matrix = np.eye(4).ravel().tolist()
    return _document(drawn | {"mtl_library": "", "resources": {}, "matrix": matrix})


def _geometry(item: Item) -> tuple[dict[str, Any], list[float]]:
    """Return a shape, and the matrix by which three.js stands it as it is here, by columns."""
    as_it_is = np.eye(4).ravel().tolist()
    if isinstance(item, Box):
        width, height, depth = item.sides.tolist()
        sides = {"width": width, "height": height, "depth": depth}
        return {"type": "BoxGeometry", **sides}, as_it_is
    if isinstance(item, Cylinder):
        round_ = {"radiusBottom": item.radius, "radiusTop": item.radius, "radialSegments": 50}
        return {"type": "CylinderGeometry", "height": item.length, **round_}, _Z_FROM_Y
    if isinstance(item, Capsule):
        round_ = {"radius": item.radius, "radialSegments": 20, "capSegments": 10}
        return {"type": "CapsuleGeometry", "height": item.length, **round_}, _Z_FROM_Y
    if isinstance(item, Ellipsoid):
        sphere = {"radius": 1.0, "widthSegments": 20, "heightSegments": 20}
        size = np.diag([*item.radii.tolist(), 1.0]).ravel().tolist()
        return {"type": "SphereGeometry", **sphere}, size
    if isinstance(item, Segments):
        ends = np.stack([item.starts, item.ends], axis=1).reshape(-1, 3)
        return _buffers({"position": ends}), as_it_is
    mesh = mesh_of(item)
    vertices = np.round(mesh.vertices / _GRAIN) * _GRAIN
    colors = {} if mesh.colors is None else {"color": mesh.colors}
    return _buffers({"position": vertices, **colors}, mesh.faces), as_it_is


def _buffers(attributes: dict[str, NDArray], faces: NDArray | None = None) -> dict[str, Any]:
    named = {name: _array(values, "Float32Array", "<f4") for name, values in attributes.items()}
    data: dict[str, Any] = {"attributes": named}
    if faces is not None:
        few = len(attributes["position"]) <= np.iinfo(np.uint16).max
        data["index"] = _array(faces, *(("Uint16Array", "<u2") if few else ("Uint32Array", "<u4")))
    return {"type": "BufferGeometry", "data": data}


def _array(values: NDArray, kind: str, binary: str) -> dict[str, Any]:
    packed = base64.b64encode(np.ascontiguousarray(values, dtype=binary)).decode()
    size = 1 if kind != "Float32Array" else 3
    return {"itemSize": size, "type": kind, "array": packed, "normalized": False}
