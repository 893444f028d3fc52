"""Spots of paint that somebody puts on what a simulated robot's cameras see, and wipes off."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import (
    FrameId,
    GeometryInstance,
    InMemoryMesh,
    Mesh,
    PerceptionProperties,
    RenderLabel,
    Rgba,
    SceneGraph,
    SourceId,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.errors import RobotError
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.names import listed
from nico_selfmodel.plant.link_surfaces import LinkSurface, link_surfaces
from nico_selfmodel.plant.model_in_plant import ModelInPlant

SMALLEST, LARGEST = 0.002, 0.03
"""Diameters that a mark may have [m]."""
GLASS = "glass"
"""Where a mark is put that is to be on the mirror."""
_RINGS, _AROUND = 5, 24
_THICK = 2e-4
"""How far paint lies above what it is on [m]."""
_BEFORE_GLASS = 1.5e-3
"""What is nearer to a glass than a millimetre counts as the glass itself [m]."""
_STEEPEST = 0.8
"""Of the mark's radius, how far the surface may fall away beneath it."""
_LABEL = 1004
_NAME = "mark"


@dataclass(frozen=True, eq=False)
class Mark:
    """A disc of paint."""

    link: str
    """What it is on: a link, `other/` and a link of the second robot, or `GLASS`."""
    p_FM: NDArray
    """Its middle in the frame of the link [m]; on the glass x is right and y down. Shape (3,)."""
    diameter: float
    """[m]."""
    color: NDArray
    """Red, green, blue, of 1. Shape (3,)."""

    def __post_init__(self) -> None:
        """Check the numbers and make the arrays read-only."""
        object.__setattr__(self, "p_FM", frozen_array(self.p_FM, (3,), "p_FM"))
        object.__setattr__(self, "color", frozen_array(self.color, (3,), "color"))
        if not SMALLEST <= self.diameter <= LARGEST:
            raise ValueError(
                f"a mark's diameter must be {1e3 * SMALLEST:g} to {1e3 * LARGEST:g} mm, got "
                f"{1e3 * self.diameter:g} mm"
            )
        if not ((self.color >= 0.0) & (self.color <= 1.0)).all():
            raise ValueError(f"a mark's colour must be three numbers of 0 to 1, got {self.color}")


@dataclass(frozen=True, eq=False)
class Paintable:
    """What a mark can be put on."""

    source: SourceId
    """Whose frame it is in the scene graph."""
    frame: FrameId
    """The frame."""
    surface: LinkSurface | None
    """Its surface; None of a flat glass, in the plane z = 0 and seen along z."""


class MarkOnBody:
    """Puts marks on a living station, and takes them off again.

    Everything is added to the station's context alone: one station does for any number of trials.
    A mark lies on the surface as paint does, and moves with its link. It is there for every camera,
    in the mirror too.
    """

    def __init__(self, scene_graph: SceneGraph) -> None:
        """Take what the cameras see; nothing of it can be painted yet."""
        self.__scene_graph = scene_graph
        self.__places: dict[str, Paintable] = {}

    def on_links(self, built: ModelInPlant, prefix: str = "") -> None:
        """Let the links of a robot be painted.

        Args:
            prefix: What their names begin with.
        """
        source = built.plant.get_source_id()
        for link, surface in link_surfaces(self.__scene_graph, built).items():
            self.__places[f"{prefix}{link}"] = Paintable(source, surface.frame, surface)

    def on_glass(self, source: SourceId, frame: FrameId) -> None:
        """Let a mirror be painted, which lies in its frame's plane z = 0 and is seen along z."""
        self.__places[GLASS] = Paintable(source, frame, None)

    @property
    def places(self) -> dict[str, LinkSurface | None]:
        """What a mark can be put on, and the surface; None of the glass."""
        return {name: place.surface for name, place in self.__places.items()}

    def paint(self, context: Context, mark: Mark) -> None:
        """Put a mark on; those that are there stay.

        Args:
            mark: The mark; what of it hangs beyond an edge of the surface is left out.

        Raises:
            RobotError: If there is nothing of that name, or no surface below the mark.
        """
        if mark.link not in self.__places:
            raise RobotError(f"nothing called {mark.link!r} to paint; there are "
                             f"{listed(sorted(self.__places))}")  # fmt: skip
        place = self.__places[mark.link]
        mesh = _flat(mark) if place.surface is None else _draped(mark, place.surface)
        if mesh is None:
            raise RobotError(f"{mark.link} has no surface at {mark.p_FM} m to paint on")
        count = len(self._painted(context))
        one = GeometryInstance(RigidTransform(), mesh, f"{_NAME}_{count}")
        properties = PerceptionProperties()
        properties.AddProperty("label", "id", RenderLabel(_LABEL))
        properties.AddProperty("phong", "diffuse", Rgba(*mark.color.tolist()))
        one.set_perception_properties(properties)
        self.__scene_graph.RegisterGeometry(context, place.source, place.frame, one)

    def wipe(self, context: Context) -> None:
        """Take all marks off."""
        for source, geometry in self._painted(context):
            self.__scene_graph.RemoveGeometry(context, source, geometry)

    def _painted(self, context: Context) -> list[tuple[SourceId, Any]]:
        """Return the marks that are there."""
        query: Any = self.__scene_graph.get_query_output_port().Eval(context)
        inspector = query.inspector()
        return [
            (place.source, geometry)
            for place in self.__places.values()
            for geometry in inspector.GetGeometries(place.frame)
            if inspector.GetName(geometry).startswith(f"{_NAME}_")
        ]


def recolored(color: ArrayLike, step: float, rng: np.random.Generator) -> NDArray:
    """Return a colour that differs by a step in a random direction.

    Args:
        color: Red, green, blue, of 1. Shape (3,).
        step: Euclidean, in RGB of 1.
        rng: Source of directions; those that lead out of 0 to 1 are drawn anew.

    Raises:
        ValueError: If no colour is as far away as that.
    """
    color = np.asarray(color, dtype=float)
    for _ in range(1000):
        way = rng.standard_normal(3)
        found = color + step * way / np.linalg.norm(way)
        if ((found >= 0.0) & (found <= 1.0)).all():
            return found
    raise ValueError(f"no colour is {step:g} from {color}: a step must be between 0 and about 1")


def _draped(mark: Mark, surface: LinkSurface) -> Mesh | None:
    """Return a disc that lies on a surface."""
    radius = 0.5 * mark.diameter
    normal = surface.normals(mark.p_FM[None])[0]
    flat = mark.p_FM + radius * normal + _disc(radius) @ tangent_basis(normal).T
    points = surface.along(flat, -normal)
    fall = np.abs((points - mark.p_FM) @ normal)
    points[~(fall < _STEEPEST * radius)] = np.nan
    if not np.isfinite(points[0]).all():
        return None
    normals = surface.normals(np.nan_to_num(points))
    return _mesh(points + _THICK * normals, normals)


def _flat(mark: Mark) -> Mesh:
    """Return a disc on a glass in the plane z = 0 that is seen along z."""
    disc = np.column_stack([_disc(0.5 * mark.diameter), np.zeros(1 + _RINGS * _AROUND)])
    middle = [mark.p_FM[0], mark.p_FM[1], -_BEFORE_GLASS]
    # Turned round, for whoever looks sees it from -z.
    return _mesh(disc * [1.0, -1.0, 1.0] + middle, np.tile([0.0, 0.0, -1.0], (len(disc), 1)))


def _disc(radius: float) -> NDArray:
    """Return the middle of a disc and rings around it. Shape (1 + rings around, 2)."""
    turn = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [radius * (k + 1) / _RINGS * ring for k in range(_RINGS)]
    return np.concatenate([np.zeros((1, 2)), *rings])


def _mesh(points: NDArray, normals: NDArray) -> Mesh:
    """Return the triangles between points of a disc; those with a nan are left out."""
    triangles = []
    for k in range(_AROUND):
        following = (k + 1) % _AROUND
        triangles.append((0, 1 + k, 1 + following))
        for ring in range(1, _RINGS):
            inner, outer = 1 + (ring - 1) * _AROUND, 1 + ring * _AROUND
            triangles += [
                (inner + k, outer + k, outer + following),
                (inner + k, outer + following, inner + following),
            ]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in np.nan_to_num(points).tolist()]
    lines += [f"vn {x!r} {y!r} {z!r}" for x, y, z in normals.tolist()]
    known = np.asarray(np.isfinite(points).all(axis=1))
    lines += [
        "f " + " ".join(f"{i + 1}//{i + 1}" for i in triangle)
        for triangle in triangles
        if known[list(triangle)].all()
    ]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", "mark.obj")))
