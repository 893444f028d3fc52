"""The robot's own body around the learned arm, from the visuals of its URDF."""

from collections.abc import Iterator
from typing import TYPE_CHECKING
from xml.dom.minidom import Element

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant.urdf_document import (
    child,
    children,
    pose_of,
    read_document,
    robot_element,
)
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.rgba import Rgba
from nico_selfmodel.viz.scene.scene import LegendEntry, path_names
from nico_selfmodel.viz.scene.scene_items import Box, Capsule, Cylinder, Ellipsoid, Item

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_OPACITY = 0.3
_LEGEND = (*palette.rgba(palette.MUTED)[:3], _OPACITY)

_SHAPES = ("box", "sphere", "cylinder", "mesh", "capsule", "drake:capsule", "drake:ellipsoid")


def robot_items(arm: "ArmDescription", model: SelfModel, q: NDArray) -> list[Item]:
    """Return the robot's body with the learned arm in a pose, translucent.

    The joint frames are the learned ones, so the body is where the self-model puts it.

    Args:
        arm: The robot and its learned chain.
        q: Joint displacements [rad]. Shape (n,).

    Returns:
        Items under `robot`, by link. Meshes are left out.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    from nico_selfmodel.plant import SelfModelPlant  # slow to load, for those who name a robot

    built = SelfModelPlant.from_urdf(arm, model)
    context = built.plant.CreateDefaultContext()
    built.set_joint_angles(context, q)
    items: list[Item] = []
    visuals_of = _visuals(arm)
    for name, (link, visuals) in zip(path_names(visuals_of), visuals_of.items(), strict=True):
        body = built.plant.GetBodyByName(link, built.instance)
        X_WL = built.plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
        for k, (shape, X_LV, color) in enumerate(visuals):
            item = _item(shape, f"robot/{name}/{k}", color, X_WL @ X_LV)
            items += [item] if item else []
    return items


def robot_legend(arm: "ArmDescription") -> list[LegendEntry]:
    """Return what the translucent body is, and whether meshes are missing from it."""
    meshes = sum(shape.tagName == "mesh" for v in _visuals(arm).values() for shape, _, _ in v)
    label = "the robot's body, on the learned arm"
    return [LegendEntry(f"{label} ({meshes} meshes not drawn)" if meshes else label, _LEGEND)]


def _visuals(arm: "ArmDescription") -> dict[str, list[tuple[Element, NDArray, Rgba]]]:
    """Return shape, pose in the link and colour of every visual, by link."""
    robot = robot_element(read_document(arm.urdf))
    materials = {m.getAttribute("name"): m for m in children(robot, "material")}
    return {
        link.getAttribute("name"): list(_visuals_of(link, materials))
        for link in children(robot, "link")
    }


def _visuals_of(
    link: Element, materials: dict[str, Element]
) -> Iterator[tuple[Element, NDArray, Rgba]]:
    for visual in children(link, "visual"):
        geometry, material = child(visual, "geometry"), child(visual, "material")
        shape = None if geometry is None else next(children(geometry, *_SHAPES), None)
        if shape is not None:
            yield shape, pose_of(child(visual, "origin")), _color(material, materials)


def _color(material: Element | None, materials: dict[str, Element]) -> Rgba:
    """Return the colour of a material, looked up by name where it has none itself."""
    if material is not None and child(material, "color") is None:
        material = materials.get(material.getAttribute("name"))
    color = None if material is None else child(material, "color")
    if color is None:
        return _LEGEND
    red, green, blue, opacity = (float(word) for word in color.getAttribute("rgba").split())
    return red, green, blue, _OPACITY * opacity


def _item(shape: Element, path: str, color: Rgba, pose: NDArray) -> Item | None:
    """Return a shape as an item; None for a mesh."""

    def size(name: str) -> float:
        return float(shape.getAttribute(name))

    kind = shape.tagName.removeprefix("drake:")
    if kind == "mesh":
        return None
    if kind == "box":
        sides = np.array([float(word) for word in shape.getAttribute("size").split()])
        return Box(path=path, color=color, X_WI=pose, sides=sides)
    if kind == "cylinder":
        return Cylinder(
            path=path, color=color, X_WI=pose, radius=size("radius"), length=size("length")
        )
    if kind == "capsule":
        return Capsule(
            path=path, color=color, X_WI=pose, radius=size("radius"), length=size("length")
        )
    radii = [size("radius")] * 3 if kind == "sphere" else [size(axis) for axis in "abc"]
    return Ellipsoid(path=path, color=color, X_WI=pose, radii=np.array(radii))
