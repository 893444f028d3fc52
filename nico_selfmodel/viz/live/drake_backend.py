"""A scene in Drake's Meshcat, live on this machine."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import Capsule as DrakeCapsule
from pydrake.geometry import Cylinder as DrakeCylinder
from pydrake.geometry import Ellipsoid as DrakeEllipsoid
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat, MeshcatParams
from pydrake.geometry import Rgba as DrakeRgba

from nico_selfmodel.errors import SelfModelError
from nico_selfmodel.viz.live.meshing import mesh_of
from nico_selfmodel.viz.live.paint import AMBIENT, BACKGROUND
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


def draw_in_drake(scene: Scene, meshcat: Meshcat | None = None) -> Meshcat:
    """Draw a scene in Drake's Meshcat, in place of the one drawn before.

    Args:
        meshcat: Where; a new server that only this machine can reach if omitted.

    Returns:
        The server. It lives as long as it is kept; `web_url()` is where to look.

    Raises:
        SelfModelError: If a new server cannot start, for example for want of a port.
    """
    meshcat = _quiet_meshcat() if meshcat is None else meshcat
    meshcat.Delete(ROOT)
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)
    for key, color in BACKGROUND.items():
        meshcat.SetProperty("/Background", key, list(color))
    meshcat.SetProperty("/Lights/AmbientLight/<object>", "intensity", AMBIENT)
    for item in scene.items:
        path = f"{ROOT}/{item.path}"
        draw_item(meshcat, path, item)
        if not np.array_equal(item.X_WI, np.eye(4)):
            meshcat.SetTransform(path, np.asfortranarray(item.X_WI))
    fov = float(np.degrees(FIELD_OF_VIEW))
    meshcat.SetCamera(Meshcat.PerspectiveCamera(fov=fov, near=0.01, far=100.0))
    meshcat.SetCameraPose(scene.camera.p_WC, scene.camera.p_WT)
    return meshcat


def draw_item(meshcat: Meshcat, path: str, item: Item) -> None:
    """Draw one item at a path, without its pose."""
    color = DrakeRgba(*item.color)
    if isinstance(item, Segments):
        starts, ends = np.asfortranarray(item.starts.T), np.asfortranarray(item.ends.T)
        meshcat.SetLineSegments(path, starts, ends, 1.0, color)
    elif isinstance(item, Box):
        meshcat.SetObject(path, DrakeBox(*item.sides), color)
    elif isinstance(item, Cylinder):
        meshcat.SetObject(path, DrakeCylinder(item.radius, item.length), color)
    elif isinstance(item, Capsule):
        meshcat.SetObject(path, DrakeCapsule(item.radius, item.length), color)
    elif isinstance(item, Ellipsoid):
        meshcat.SetObject(path, DrakeEllipsoid(*item.radii), color)
    elif isinstance(item, Picture):
        _draw_file(meshcat, path, picture_gltf(item))
    elif isinstance(item, Surface) and item.colors is not None:
        _draw_file(meshcat, path, surface_gltf(item, item.colors))
    else:
        mesh = mesh_of(item)
        vertices = np.asfortranarray(mesh.vertices.T)
        faces = np.asfortranarray(mesh.faces.T.astype(np.int32))
        if mesh.colors is None:
            meshcat.SetTriangleMesh(path, vertices, faces, color)
        else:
            colors = np.asfortranarray(mesh.colors.T)
            meshcat.SetTriangleColorMesh(path, vertices, faces, colors)


def _draw_file(meshcat: Meshcat, path: str, gltf: str) -> None:
    file = MemoryFile(gltf, ".gltf", "item")
    meshcat.SetObject(path, Mesh(InMemoryMesh(mesh_file=file)))


def _quiet_meshcat() -> Meshcat:
    with _drake_messages_off():
        try:
            return Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
        except RuntimeError as error:
            raise SelfModelError(
                f"Drake's Meshcat could not start, which the 3D scene needs: {error}"
            ) from error


@contextmanager
def _drake_messages_off() -> Iterator[None]:
    """Keep Drake from announcing the address, which belongs to whoever shows the scene."""
    logger = logging.getLogger("drake")
    before = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(before)
