"""Flat cards with a picture on them, for scene graphs."""

from hashlib import sha256

from pydrake.common import MemoryFile
from pydrake.geometry import GeometryInstance, InMemoryMesh, Mesh, PerceptionProperties, RenderLabel
from pydrake.math import RigidTransform

_MATERIAL = "newmtl card\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nmap_Kd {picture}\n"


def textured_card(
    name: str, png: bytes, size: tuple[float, float], X_FC: RigidTransform, label: int
) -> GeometryInstance:
    """Return a card that renderers can see.

    In its own frame C, in the middle of the card, x is the picture's right and y its down, so that
    whoever looks along z sees the picture the right way round.

    Args:
        name: What the geometry is called; unique on its frame.
        size: Width and height [m].
        X_FC: Pose of the card in the frame that carries it.
        label: Number of the card in label images.

    Returns:
        What `SceneGraph.RegisterGeometry` takes.
    """
    x, y = 0.5 * size[0], 0.5 * size[1]
    # Renderers keep pictures by the names of their files, as if they were on a disk.
    known = sha256(png).hexdigest()
    material, picture = f"{known}.mtl", f"{known}.png"
    lines = [f"mtllib {material}", "usemtl card"]
    for px, py, u, v in ((-x, -y, 0, 1), (x, -y, 1, 1), (x, y, 1, 0), (-x, y, 0, 0)):
        lines += [f"v {px!r} {py!r} 0", f"vt {u} {v}"]
    # Seen from -z, so that the normal points there.
    lines += ["vn 0 0 -1", "f 1/1/1 4/4/1 3/3/1", "f 1/1/1 3/3/1 2/2/1"]
    mesh = InMemoryMesh(
        mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", f"{name}.obj"),
        supporting_files={
            material: MemoryFile(_MATERIAL.format(picture=picture), ".mtl", material),
            picture: MemoryFile(png, ".png", picture),
        },
    )
    instance = GeometryInstance(X_FC, Mesh(mesh), name)
    properties = PerceptionProperties()
    properties.AddProperty("label", "id", RenderLabel(label))
    instance.set_perception_properties(properties)
    return instance
