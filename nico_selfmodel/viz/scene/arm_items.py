"""The learned arm as shapes: rounded links, joints about their axes, frames, the hand."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import frame_along
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import called
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.arm_shape import joint_points
from nico_selfmodel.viz.scene.scene import LegendEntry, path_names
from nico_selfmodel.viz.scene.scene_items import (
    Capsule,
    Cylinder,
    Ellipsoid,
    Item,
    Needles,
    Triad,
    Tube,
)

_LINK_RADIUS = 0.026
_JOINT_RADIUS, _JOINT_LENGTH = 0.046, 0.12
_AXIS_RADIUS, _AXIS_REACH = 0.0045, 0.22
_HAND_RADIUS = 0.032
_FRAME_LENGTH, _FRAME_RADIUS = 0.17, 0.006


def arm_items(model: SelfModel, q: NDArray, unit: float) -> list[Item]:
    """Return the arm in a pose.

    Args:
        q: Joint displacements [rad]. Shape (n,).
        unit: Length that sizes are fractions of [m].

    Returns:
        Items under `arm`, `joint_axes` and `dh_frames`.
    """
    chain = model.chain.rezeroed(q)
    points = joint_points(chain)
    return [
        *_links(points, chain.p_WH_zero, model, unit),
        *_joints(points, chain.directions, model, unit),
        *_frames(model, q, unit),
    ]


def arm_legend(model: SelfModel) -> list[LegendEntry]:
    """Return one entry a joint."""
    return [
        LegendEntry(called("joint", joint), palette.rgba(palette.joint_color(i)))
        for i, joint in enumerate(model.joints)
    ]


def _links(points: NDArray, hands: NDArray, model: SelfModel, unit: float) -> list[Item]:
    color, radius = palette.rgba(palette.LINK), _LINK_RADIUS * unit
    ends = [*points[1:], hands[0]]
    items: list[Item] = []
    for joint, start, end in zip(path_names(model.joints), points, ends, strict=True):
        link = _capsule(f"arm/link_of_{joint}", start, end, radius, color)
        items += [link] if link else []
    markers = path_names(model.markers)
    for marker, hand in zip(markers, hands, strict=True):
        name = f"arm/hand_{marker}"
        radii = np.full(3, _HAND_RADIUS * unit)
        pose = transform(np.eye(3), hand)
        items.append(Ellipsoid(path=name, color=palette.rgba(palette.HAND), X_WI=pose, radii=radii))
    for marker, hand in zip(markers[1:], hands[1:], strict=True):
        name = f"arm/palm_to_{marker}"
        palm = _capsule(name, hands[0], hand, 0.5 * radius, color)
        items += [palm] if palm else []
    return items


def _capsule(
    path: str, start: NDArray, end: NDArray, radius: float, color: palette.Rgba
) -> Capsule | None:
    """Return a capsule between two points, or None where a joint's own body hides it."""
    length = float(np.linalg.norm(end - start))
    if length < 0.5 * radius:
        return None
    pose = transform(frame_along((end - start) / length), 0.5 * (start + end))
    return Capsule(path=path, color=color, X_WI=pose, radius=radius, length=length)


def _joints(points: NDArray, directions: NDArray, model: SelfModel, unit: float) -> list[Item]:
    items: list[Item] = []
    for i, name in enumerate(path_names(model.joints)):
        pose = transform(frame_along(directions[i]), points[i])
        color = palette.joint_color(i)
        items.append(
            Cylinder(
                path=f"arm/joint_{name}",
                color=palette.rgba(color),
                X_WI=pose,
                radius=_JOINT_RADIUS * unit,
                length=_JOINT_LENGTH * unit,
            )
        )
        reach = _AXIS_REACH * unit * np.array([0.0, 0.0, 1.0])
        line = np.stack([-reach, reach])
        radius = _AXIS_RADIUS * unit
        tint = palette.rgba(color, 0.75)
        path = f"joint_axes/{name}"
        items.append(Tube(path=f"{path}/line", color=tint, X_WI=pose, points=line, radius=radius))
        tip = Needles(
            path=f"{path}/positive_end",
            color=palette.rgba(color),
            X_WI=pose,
            starts=reach[None],
            ends=1.25 * reach[None],
            radius=3.0 * radius,
        )
        items.append(tip)
    return items


def _frames(model: SelfModel, q: NDArray, unit: float) -> list[Item]:
    after = [f"frame_{i + 1}_{joint}" for i, joint in enumerate(path_names(model.joints))]
    return [
        Triad(
            path=f"dh_frames/{name}",
            color=(1.0, 1.0, 1.0, 1.0),
            X_WI=pose,
            length=_FRAME_LENGTH * unit,
            radius=_FRAME_RADIUS * unit,
        )
        for name, pose in zip(["frame_0", *after], model.dh.frames(q), strict=True)
    ]
