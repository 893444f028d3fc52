"""A self-model as a URDF: the robot's own file with the learned geometry written into it."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING
from xml.dom.minidom import Document, Element

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.arm.bending import EFFECTS
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant.export.plain_urdf import DENSITY, link_name, plain_document
from nico_selfmodel.plant.learned_frames import LearnedFrames, learned_frames, nominal_frames
from nico_selfmodel.plant.urdf_document import (
    JOINTS,
    append_frame_link,
    child,
    children,
    comment_text,
    document_text,
    hand_frame_name,
    lead_files,
    linked,
    numbers_text,
    origin_of,
    pose_of,
    read_document,
    robot_element,
    set_origin,
    set_pose,
)

if TYPE_CHECKING:
    # It loads Drake's plant, which a robot of spheres and cylinders does not need.
    from nico_selfmodel.plant.description import ArmDescription
    from nico_selfmodel.plant.export.shape_urdf import ShapeInUrdf

MEASURING_FRAME = "measuring_frame"
"""The link that stands for the measuring frame W."""
_PARTS = ("visual", "collision", "inertial")


def learned_urdf(
    model: SelfModel,
    description: "ArmDescription | None" = None,
    folder: str | Path | None = None,
    shape: "ShapeInUrdf | None" = None,
) -> str:
    """Write a self-model as a URDF.

    With a description it is the robot's own file: links, limits, meshes and masses stay, joint
    origins change, and what hangs on the links moves with them. Limits of a self-model that has
    zeros of its own are counted from these. Without one, a robot of spheres
    and cylinders is drawn along the learned axes. Either way the link `measuring_frame` is the
    frame W and a link `hand_<marker>` stands at each tracked point; a link without mass, shape or
    children that was given as a tracked point moves there too. Positions of the joints are the
    self-model's q. Encoders do not fit in a URDF: their offsets and gears are in the
    self-model's YAML.

    Args:
        description: The robot it belongs to.
        folder: Where the file will lie. Relative mesh paths are rewritten to lead there from
            this folder; without it they stay as they are, right only beside the original.
            Absolute and `package://` paths always stay.
        shape: What links look like as they were learned; they look as described if omitted.

    Raises:
        ModelError: If the model has other joints than the description, the URDF is gone, or the
            shape is of links that the robot has not.
    """
    if description is None:
        document = plain_document(model, MEASURING_FRAME)
    else:
        document = _edited_document(model, description)
        if folder is not None:
            original, there = description.urdf.parent, real_path(Path(folder))
            lead_files(
                robot_element(document),
                lambda name: Path(os.path.relpath(original / name, there)).as_posix(),
            )
    if shape is not None:
        moved = {} if description is None else _urdf_frames(description, model)[1]
        shape.put(robot_element(document), moved)
    note = comment_text(
        f" The learned geometry of {model.name}. Joint positions are angles of the links: offsets "
        "and gears of the encoders are in self_model.yaml, a URDF cannot hold them. "
        f"{masses_words(model, description)} {_rigid_words(model)}"
    )
    document.insertBefore(document.createComment(note), robot_element(document))
    return document_text(document)


def _rigid_words(model: SelfModel) -> str:
    """Say that what bends is not in the file."""
    if model.bending is None:
        return ""
    bends = ", ".join(effect for effect in EFFECTS if effect in model.bending.effects)
    return (
        "It is rigid: the geometry without its own weight. What bends "
        f"({bends}) is in self_model.yaml alone. "
    )


def masses_words(model: SelfModel, description: "ArmDescription | None") -> str:
    """Return which masses of a learned URDF are the robot's own, and which were invented.

    Args:
        description: The robot it belongs to; None where there is none.
    """
    if description is not None:
        return "Masses and inertias are the robot's own, those of its file: none was invented."
    links = ", ".join(link_name(joint) for joint in model.joints)
    return (
        f"Masses and inertias of {links} are invented: of the drawn shapes, at {DENSITY:g} kg/m^3, "
        "only because simulators want some."
    )


def _edited_document(model: SelfModel, arm: "ArmDescription") -> Document:
    """Return the robot's file with the learned chain in it.

    A URDF's joint turns its child link's frame itself. So each learned link's frame is put
    where the joint's child frame has to be, and everything fixed to the link is moved back.
    """
    document = read_document(arm.urdf)
    robot = robot_element(document)
    origins, moved = _urdf_frames(arm, model)
    frames = learned_frames(arm, model.chain)
    _move_points(robot, arm, frames)
    for joint in children(robot, *JOINTS):
        name = joint.getAttribute("name")
        before = moved.get(linked(joint, "parent"))
        if name in origins:
            pose = origins[name] if before is None else before @ origins[name]
            set_origin(joint, pose)
        elif before is not None:
            set_origin(joint, before @ origin_of(joint))
    _count_from(robot, dict(zip(arm.joints, frames.zeros.tolist(), strict=True)))
    for link in children(robot, "link"):
        if link.getAttribute("name") in moved:
            for part in children(link, *_PARTS):
                set_origin(part, moved[link.getAttribute("name")] @ origin_of(part))
    for frame in children(robot, "frame"):
        if frame.getAttribute("link") in moved:
            set_pose(frame, moved[frame.getAttribute("link")] @ pose_of(frame))
    _add_frames(robot, arm, frames, moved)
    return document


def _count_from(robot: Element, zeros: Mapping[str, float]) -> None:
    """Let limits, and what mimics, be counted from other zeros, where these are others [rad]."""
    for joint in children(robot, "joint"):
        limit, mimic = child(joint, "limit"), child(joint, "mimic")
        if limit is not None and joint.getAttribute("type") != "continuous":
            for end in ("lower", "upper"):
                _add_to(limit, end, -zeros.get(joint.getAttribute("name"), 0.0))
        if mimic is not None:
            gear = float(mimic.getAttribute("multiplier") or 1.0)
            _add_to(mimic, "offset", gear * zeros.get(mimic.getAttribute("joint"), 0.0))


def _add_to(element: Element, name: str, value: float) -> None:
    """Add to a number of the file; it stays as it is written where nothing is to be added."""
    if value:
        before = float(element.getAttribute(name) or 0.0)
        element.setAttribute(name, numbers_text(before + value))


def _urdf_frames(
    arm: "ArmDescription", model: SelfModel
) -> tuple[dict[str, NDArray], dict[str, NDArray]]:
    """Return learned joint origins, and for each learned link its old frame in its new one.

    Both frames of a joint may be moved together by K. K = X_CM^-1 of the nominal arm keeps the
    joint's axis as the file has it, and a link's frame near where it was.
    """
    nominal, learned = nominal_frames(arm, model.chain), learned_frames(arm, model.chain)
    K = inverse(nominal.X_CM)
    origins = dict(zip(arm.joints, learned.X_PF @ K, strict=True))
    moved = dict(zip(arm.links.child_links, inverse(learned.X_CM @ K), strict=True))
    return origins, moved


def _move_points(robot: Element, arm: "ArmDescription", frames: LearnedFrames) -> None:
    """Move the links and frames that mark tracked points, where they are nothing else."""
    for marker, X_TH_nominal in zip(
        arm.markers, inverse(arm.links.X_BT) @ arm.links.X_BH, strict=True
    ):
        if marker not in frames.markers:
            continue
        step = inverse(X_TH_nominal) @ frames.X_TH[frames.markers.index(marker)]
        name = arm.points[marker]
        for frame in children(robot, "frame"):
            if frame.getAttribute("name") == name:
                set_pose(frame, pose_of(frame) @ step)
        mount = _mount_of_bare_link(robot, name)
        if mount is not None:
            set_origin(mount, origin_of(mount) @ step)


def _mount_of_bare_link(robot: Element, name: str) -> Element | None:
    """Return the fixed joint of a link without mass, shape and children; None if it has any."""
    joints = list(children(robot, *JOINTS))
    if any(linked(joint, "parent") == name for joint in joints):
        return None
    for link in children(robot, "link"):
        if link.getAttribute("name") == name and next(children(link, *_PARTS), None) is not None:
            return None
    mounts = [joint for joint in joints if linked(joint, "child") == name]
    return mounts[0] if mounts and mounts[0].getAttribute("type") == "fixed" else None


def _add_frames(
    robot: Element, arm: "ArmDescription", frames: LearnedFrames, moved: dict[str, NDArray]
) -> None:
    """Add links for the measuring frame and the tracked points, in place of older ones."""
    tip = moved.get(arm.tip_link, np.eye(4))
    added = {MEASURING_FRAME: (arm.links.root_link, inverse(frames.X_WR))}
    for marker, X_TH in zip(frames.markers, frames.X_TH, strict=True):
        added[hand_frame_name(marker)] = (arm.tip_link, tip @ X_TH)
    for name, (parent, pose) in added.items():
        _remove_bare_link(robot, name)
        append_frame_link(robot, name, parent, pose)


def _remove_bare_link(robot: Element, name: str) -> None:
    for link in children(robot, "link"):
        if link.getAttribute("name") != name:
            continue
        mount = _mount_of_bare_link(robot, name)
        if mount is None:
            raise ModelError(
                f"the URDF has a link {name!r} of its own, which the export needs for a frame: "
                "rename it"
            )
        robot.removeChild(link)
        robot.removeChild(mount)
