"""Round solids as meshes that are as fine as a camera can tell, and no finer.

Drake's renderer makes thousands of triangles of each ball, capsule and ellipsoid, however small it
is. A software renderer takes longer for those of one hand than for the pixels they cover.
"""

import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import (
    Capsule,
    Ellipsoid,
    GeometryInstance,
    InMemoryMesh,
    Mesh,
    PerceptionProperties,
    Role,
    SceneGraph,
    Shape,
    SourceId,
    Sphere,
)

_INSIDE = 1e-4
"""How far the middle of a triangle may lie below its corners [m]."""
_LEAST, _MOST = 12, 50
"""Corners around a solid; Drake makes 50."""


def draw_coarsely(scene_graph: SceneGraph, source: SourceId) -> None:
    """Let renderers see meshes in place of the round solids of a source, in the same colours.

    The solids stay for everything but renderers. Meshes hold as much as they: a tenth of a
    millimetre is too much or missing at most, a sixth of a pixel where Nico's cameras see its hand.

    Args:
        scene_graph: Where they are drawn; nobody asks it for solids that are seen any more.
        source: Whose.
    """
    inspector = scene_graph.model_inspector()
    for frame in inspector.FramesForSource(source):
        for geometry in inspector.GetGeometries(frame, Role.kPerception):
            mesh = _mesh(inspector.GetShape(geometry))
            if mesh is None:
                continue
            name = f"{inspector.GetName(geometry)}_drawn"
            drawn = GeometryInstance(inspector.GetPoseInFrame(geometry), mesh, name)
            properties = PerceptionProperties(inspector.GetPerceptionProperties(geometry))
            drawn.set_perception_properties(properties)
            scene_graph.RemoveRole(source, geometry, Role.kPerception)
            scene_graph.RegisterGeometry(source, frame, drawn)


def _mesh(shape: Shape) -> Mesh | None:
    """Return a mesh of a shape; None of one that is not round all over."""
    if isinstance(shape, Sphere):
        return _obj(np.full(3, shape.radius()), 0.0)
    if isinstance(shape, Ellipsoid):
        return _obj(np.array([shape.a(), shape.b(), shape.c()]), 0.0)
    if isinstance(shape, Capsule):
        return _obj(np.full(3, shape.radius()), shape.length())
    return None


def _obj(axes: NDArray, length: float) -> Mesh:
    """Return an ellipsoid, cut in the middle and drawn out along z.

    Args:
        axes: Half axes along x, y, z [m]. Shape (3,).
        length: By how much [m].
    """
    around = _corners_around(float(axes.max()))
    half = (around + 3) // 4  # rings from the equator to a pole
    latitudes = 0.5 * np.pi * np.arange(1 - half, half) / half
    below = np.concatenate([latitudes <= 0.0, [True, False]])
    if length > 0.0:  # the equator twice, once at each end of the drawn out part
        latitudes = np.sort(np.append(latitudes, 0.0))
        below = np.concatenate([np.arange(2 * half) < half, [True, False]])
    rings = len(latitudes)
    longitudes = 2.0 * np.pi * np.arange(around) / around
    wide, high = np.cos(latitudes)[:, None], np.sin(latitudes)[:, None]
    unit = np.stack(
        [wide * np.cos(longitudes), wide * np.sin(longitudes), high + 0.0 * longitudes], axis=-1
    ).reshape(-1, 3)
    unit = np.concatenate([unit, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    faces = _triangles(rings, around)
    points = unit * axes
    ends = np.concatenate([np.repeat(below[:-2], around), below[-2:]])
    middle = np.where(ends, -0.5 * length, 0.5 * length)
    points[:, 2] += middle
    points = unit * (axes * _larger(points[faces], axes, length))
    points[:, 2] += middle
    normals = unit / axes
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points.tolist()]
    lines += [f"vn {x:.6g} {y:.6g} {z:.6g}" for x, y, z in normals.tolist()]
    lines += [f"f {a}//{a} {b}//{b} {c}//{c}" for a, b, c in (faces + 1).tolist()]
    return Mesh(InMemoryMesh(mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", "round.obj")))


def _larger(corners: NDArray, axes: NDArray, length: float) -> float:
    """Return by how much a mesh must be larger about its middle to hold what its solid does.

    With corners on the surface V - V_mesh is missing; the volume grows by k of the half axes as
    V(k) = pi a b k^2 length + 4/3 pi a b c k^3.

    Args:
        corners: Of the triangles. Shape (N, 3, 3).
    """
    drawn = float(np.linalg.det(corners).sum()) / 6.0
    disc, ball = np.pi * axes[0] * axes[1] * length, 4.0 / 3.0 * np.pi * float(np.prod(axes))
    return 1.0 + (disc + ball - drawn) / (2.0 * disc + 3.0 * ball)


def _triangles(rings: int, around: int) -> NDArray:
    """Return corners of the triangles between rings and at the poles, which are numbered last.

    Counterclockwise seen from outside. Shape (N, 3).
    """
    here = np.arange(around)
    there = (here + 1) % around
    low = around * np.arange(rings - 1)[:, None]
    a, b, c, d = (low + here, low + there, low + around + there, low + around + here)
    sides = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    south, north = np.full(around, rings * around), np.full(around, rings * around + 1)
    last = around * (rings - 1)
    caps = [np.stack([there, here, south], -1), np.stack([last + here, last + there, north], -1)]
    return np.concatenate([sides, *caps])


def _corners_around(radius: float) -> int:
    """Return how many corners a circle needs for chords to stay near to it."""
    half = np.arccos(max(1.0 - _INSIDE / radius, -1.0))
    return int(np.clip(np.ceil(np.pi / half), _LEAST, _MOST))
