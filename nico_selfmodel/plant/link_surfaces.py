"""What the links of a robot look like by its description: solids and their colours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    FrameId,
    Rgba,
    Role,
    SceneGraph,
    Shape,
    Sphere,
)

from nico_selfmodel.arrays import read_only
from nico_selfmodel.geometry.solids.solid import (
    Solid,
    distance_to_solids,
    normals_of_solids,
    onto_solids,
)
from nico_selfmodel.plant.model_in_plant import ModelInPlant


@dataclass(frozen=True, eq=False)
class LinkSurface:
    """The surface of one link, in its frame."""

    frame: FrameId
    """Its frame in the scene graph."""
    solids: tuple[Solid, ...]
    """What it is made of."""
    colors: NDArray
    """Red, green and blue of each solid, of 1. Shape (solids, 3)."""

    def distance(self, p_FQ: NDArray) -> NDArray:
        """Return how far points are outside [m]. Shape (N, 3) -> (N,)."""
        return distance_to_solids(self.solids, p_FQ)[0]

    def normals(self, p_FQ: NDArray) -> NDArray:
        """Return the normals at points of the surface. Shape (N, 3)."""
        return normals_of_solids(self.solids, p_FQ)

    def color(self, p_FQ: NDArray) -> NDArray:
        """Return the colour at one point of the surface. Shape (3,) -> (3,)."""
        return self.colors[distance_to_solids(self.solids, p_FQ[None])[1][0]]

    def recolored(self, colors: Mapping[tuple[float, ...], Sequence[float]]) -> "LinkSurface":
        """Return the same in other colours: old colour -> new one; others stay."""
        each = [colors.get(tuple(color), color) for color in self.colors.tolist()]
        return replace(self, colors=read_only(each, float))

    def along(self, p_FQ: NDArray, way: NDArray) -> NDArray:
        """Return where points that move along a direction meet the surface. Shape (N, 3)."""
        return onto_solids(self.solids, p_FQ, way)


def link_surfaces(scene_graph: SceneGraph, built: ModelInPlant) -> dict[str, LinkSurface]:
    """Return the surfaces of all links that are made of simple solids only.

    Args:
        scene_graph: Where the robot is drawn.

    Returns:
        Link -> surface; links with meshes, and those that nothing is drawn of, are left out.
    """
    plant, inspector = built.plant, scene_graph.model_inspector()
    found: dict[str, LinkSurface] = {}
    for index in plant.GetBodyIndices(built.instance):
        frame = plant.GetBodyFrameIdIfExists(index)
        if frame is None:
            continue
        drawn = inspector.GetGeometries(frame, Role.kPerception)
        solids = [
            _solid(inspector.GetShape(one), inspector.GetPoseInFrame(one).GetAsMatrix4())
            for one in drawn
        ]
        known = tuple(solid for solid in solids if solid is not None)
        if known and len(known) == len(solids):
            colors = np.array(
                [_color(inspector.GetPerceptionProperties(one)) for one in drawn], dtype=float
            )
            link = plant.get_body(index).name()
            found[link] = LinkSurface(frame, known, read_only(colors))
    return found


def _solid(shape: Shape, X_FS: NDArray) -> Solid | None:
    """Return a shape of Drake's as a solid; None if it is another."""
    if isinstance(shape, Sphere):
        return Solid("ellipsoid", (shape.radius(),) * 3, X_FS)
    if isinstance(shape, Ellipsoid):
        return Solid("ellipsoid", (shape.a(), shape.b(), shape.c()), X_FS)
    if isinstance(shape, Capsule):
        return Solid("capsule", (shape.radius(), shape.length()), X_FS)
    if isinstance(shape, Cylinder):
        return Solid("cylinder", (shape.radius(), shape.length()), X_FS)
    if isinstance(shape, Box):
        return Solid("box", tuple(shape.size().tolist()), X_FS)
    return None


def _color(properties: object) -> tuple[float, float, float]:
    color = properties.GetPropertyOrDefault("phong", "diffuse", Rgba(0.9, 0.9, 0.9))  # type: ignore[attr-defined]
    return color.r(), color.g(), color.b()
