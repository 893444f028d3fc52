"""The learned shape of links in a URDF: its mesh to be seen, capsules around it to collide."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from xml.dom.minidom import Element

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.solids.capsule_fit import fit_capsules
from nico_selfmodel.geometry.solids.solid import Solid, distance_to_solids
from nico_selfmodel.model.shape.link_shape import BodyShape, LinkShape
from nico_selfmodel.model.shape.shape_folder import file_names
from nico_selfmodel.plant.urdf_document import append, child, children, numbers_text, set_origin

MOST_CAPSULES = 4
"""Of a link."""
OBJ, MTL = ".obj", ".mtl"


UNSEEN = (0.62, 0.64, 0.67)
"""Red, green and blue of what was never seen."""
_STEPS = 8
"""Of each of red, green and blue: an OBJ has a paint a triangle, and programs take some dozens."""


@dataclass(frozen=True, eq=False)
class ShapeInUrdf:
    """What a URDF says of a learned shape."""

    shape: BodyShape
    """The shape."""
    capsules: Mapping[str, tuple[Solid, ...]]
    """Link -> capsules that hold all that was seen of it, in its frame in the description."""
    folder: str
    """Of the meshes, beside the URDF."""

    @classmethod
    def beside(cls, urdf: Path, shape: BodyShape) -> "ShapeInUrdf":
        """Fit capsules to a shape whose meshes will lie in a folder beside a URDF.

        Args:
            urdf: The file, which need not be there.

        Raises:
            ModelError: If nothing was seen of one of its links.
        """
        capsules = {link: _capsules(own) for link, own in shape.links.items()}
        return cls(shape, MappingProxyType(capsules), f"{urdf.stem}_shape")

    @property
    def files(self) -> dict[str, str]:
        """Name in the folder -> content: each link's mesh in its frame, and the paints of it."""
        found: dict[str, str] = {}
        paints = file_names(self.shape, MTL)
        for link, mesh in file_names(self.shape, OBJ).items():
            own = self.shape.links[link]
            found[mesh], found[paints[link]] = painted_obj(own, paints[link])
        return found

    @property
    def words(self) -> str:
        """How many capsules links have, and which share of what was seen is in them."""
        return "; ".join(
            f"{link}: {len(own)} capsule{'s' if len(own) > 1 else ''} about "
            f"{100.0 * share_within(own, self.shape.links[link]):.1f} % of what was seen"
            for link, own in self.capsules.items()
        )

    def put(self, robot: Element, moved: Mapping[str, NDArray]) -> None:
        """Put meshes and capsules in the place of what was drawn and collided before.

        Args:
            robot: The `<robot>`.
            moved: Link -> its frame in the description, in its frame in this URDF, where these
                are not the same. Shape (4, 4) each.

        Raises:
            ModelError: If the robot has no such link.
        """
        links = {link.getAttribute("name"): link for link in children(robot, "link")}
        self.shape.check_links(links)
        for name, file in file_names(self.shape, OBJ).items():
            link, X_NF = links[name], moved.get(name, np.eye(4))
            _take_away(robot, link)
            _append_visual(link, f"{self.folder}/{file}", X_NF)
            for capsule in self.capsules[name]:
                _append_capsule(link, capsule, X_NF)


def share_within(capsules: tuple[Solid, ...], shape: LinkShape) -> float:
    """Return the share of the vertices seen that are in capsules, or outside by a sigma at most."""
    outside = distance_to_solids(capsules, shape.mesh.vertices[shape.seen])[0]
    return float(np.mean(outside <= shape.sigma[shape.seen]))


def _capsules(shape: LinkShape) -> tuple[Solid, ...]:
    if not shape.seen.any():
        raise ModelError(
            f"nothing of link {shape.link!r} was seen, so that no capsule can be fitted: learn its "
            "shape anew"
        )
    return fit_capsules(shape.mesh.vertices[shape.seen], MOST_CAPSULES)


def _take_away(robot: Element, link: Element) -> None:
    """Remove what is drawn and collides of a link; colours that others may name stay."""
    known = {material.getAttribute("name") for material in children(robot, "material")}
    for part in children(link, "visual", "collision"):
        material = child(part, "material")
        if material is not None and child(material, "color") is not None:
            name = material.getAttribute("name")
            if name and name not in known:
                robot.insertBefore(material, robot.firstChild)
                known.add(name)
        link.removeChild(part)


def _append_visual(link: Element, mesh: str, pose: NDArray) -> None:
    visual = append(link, "visual")
    set_origin(visual, pose)
    append(append(visual, "geometry"), "mesh", filename=mesh)


def _append_capsule(link: Element, capsule: Solid, pose: NDArray) -> None:
    collision = append(link, "collision")
    set_origin(collision, pose @ capsule.X_FS)
    radius, length = (numbers_text(value) for value in capsule.size)
    append(append(collision, "geometry"), "drake:capsule", radius=radius, length=length)


def painted_obj(shape: LinkShape, mtl: str) -> tuple[str, str]:
    """Return a surface in its link's frame, and its paints.

    Triangles of which a corner was never seen are grey. Colours stand after each vertex too, as
    MeshLab and Blender read them.

    Args:
        mtl: Name of the file of paints, beside the OBJ.

    Returns:
        Content of the OBJ, and of the MTL.
    """
    colors = np.where(shape.seen[:, None], shape.colors, UNSEEN)
    rows = np.column_stack([shape.mesh.vertices, colors])
    lines = [f"# {shape.link}, as it was learned, in its own frame [m]", f"mtllib {mtl}"]
    lines += ["v {!r} {!r} {!r} {:.4f} {:.4f} {:.4f}".format(*row) for row in rows.tolist()]
    lines += ["vn {:.5f} {:.5f} {:.5f}".format(*row) for row in shape.mesh.normals.tolist()]
    paints, of_triangle = np.unique(_paints(shape), axis=0, return_inverse=True)
    for k, paint in enumerate(paints):
        corners = shape.mesh.triangles[of_triangle.ravel() == k] + 1
        lines += [f"usemtl {_name(paint)}"]
        lines += ["f {0}//{0} {1}//{1} {2}//{2}".format(*row) for row in corners.tolist()]
    kinds = [f"newmtl {_name(paint)}\nKd {_numbers(paint)}\nKa 0 0 0\nKs 0 0 0" for paint in paints]
    return "\n".join(lines) + "\n", "\n\n".join(kinds) + "\n"


def _paints(shape: LinkShape) -> NDArray:
    """Return the colour of each triangle, to one of a few. Shape (T, 3)."""
    seen = shape.seen[shape.mesh.triangles].all(axis=1, keepdims=True)
    mean = shape.colors[shape.mesh.triangles].mean(axis=1)
    return np.where(seen, np.round(_STEPS * mean) / _STEPS, UNSEEN)


def _name(paint: NDArray) -> str:
    if np.array_equal(paint, UNSEEN):
        return "never_seen"
    return "paint_" + "_".join(str(round(_STEPS * part)) for part in paint.tolist())


def _numbers(paint: NDArray) -> str:
    return " ".join(f"{part:g}" for part in paint.tolist())
