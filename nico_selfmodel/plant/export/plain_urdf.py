"""A URDF from a self-model alone: spheres at the joints, cylinders between them."""

import re
from xml.dom.minidom import Document, Element

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.rotation import frame_along
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant.urdf_document import (
    append,
    append_frame_link,
    hand_frame_name,
    numbers_text,
    set_origin,
)

BASE = "base"
DENSITY = 500.0
"""Of the drawn shapes [kg/m^3]; masses are only there because simulators want some."""


def plain_document(model: SelfModel, measuring_frame: str) -> Document:
    """Draw a self-model as a URDF.

    At zero all link frames are parallel to W; a joint's axis is its line's direction. The robot
    hangs on a link `base`, which is W.

    Args:
        measuring_frame: Name of a link to mark W with.
    """
    document = Document()
    robot = document.createElement("robot")
    document.appendChild(robot)
    robot.setAttribute("name", re.sub(r"\W+", "_", model.name) or "learned")
    chain = model.chain
    centres = _joint_centres(chain)
    ends = np.vstack([centres[1:], chain.p_WH_zero[:1]])
    thickness = 0.12 * (np.linalg.norm(ends - centres, axis=1).sum() or 1.0)
    append(robot, "link", name=BASE)
    parent, before = BASE, np.zeros(3)
    for i, name in enumerate(chain.joints):
        link = append(robot, "link", name=link_name(name))
        _draw(link, ends[i] - centres[i], thickness)
        joint = append(robot, "joint", name=name, type="continuous")
        append(joint, "parent", link=parent)
        append(joint, "child", link=link_name(name))
        set_origin(joint, transform(np.eye(3), centres[i] - before))
        append(joint, "axis", xyz=numbers_text(chain.directions[i]))
        parent, before = link_name(name), centres[i]
    append_frame_link(robot, measuring_frame, BASE, np.eye(4))
    for marker, p in zip(chain.markers, chain.p_WH_zero, strict=True):
        pose = transform(np.eye(3), p - before)
        append_frame_link(robot, hand_frame_name(marker), parent, pose)
    return document


def link_name(joint: str) -> str:
    """Return the name of the link that a joint moves."""
    return f"{joint}_link"


def _joint_centres(chain: Chain) -> NDArray:
    """Choose a point on every axis, from the hand inwards: the one nearest to the next.

    Estimates may hold points anywhere along their axes. Shape (n, 3).
    """
    centres, target = [], chain.p_WH_zero[0]
    for point, direction in zip(chain.points[::-1], chain.directions[::-1], strict=True):
        target = point + ((target - point) @ direction) * direction
        centres.append(target)
    return np.stack(centres[::-1])


def _draw(link: Element, reach: NDArray, thickness: float) -> None:
    """Give a link a ball at its joint, a rod to the next one, and the mass of both."""
    radius, length = 0.5 * thickness, float(np.linalg.norm(reach))
    ball = 4.0 / 3.0 * np.pi * radius**3 * DENSITY
    rod = np.pi * (0.6 * radius) ** 2 * length * DENSITY
    mass = ball + rod
    inertial = append(link, "inertial")
    append(inertial, "mass", value=numbers_text(mass))
    # A ball that has the mass of both, as far out as the rod reaches: large enough to be possible.
    moment = numbers_text(0.4 * mass * radius**2 + rod * length**2 / 12.0)
    zero = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    append(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, **zero)
    set_origin(inertial, transform(np.eye(3), 0.5 * reach * (rod / mass)))
    _shape(link, np.eye(4), "sphere", radius=numbers_text(radius))
    if length > radius:
        z = reach / length
        pose = transform(frame_along(z), 0.5 * reach)
        _shape(
            link, pose, "cylinder", radius=numbers_text(0.6 * radius), length=numbers_text(length)
        )


def _shape(link: Element, pose: NDArray, tag: str, **size: str) -> None:
    visual = append(link, "visual")
    set_origin(visual, pose)
    append(append(visual, "geometry"), tag, **size)
    material = append(visual, "material", name="learned")
    append(material, "color", rgba="0.55 0.62 0.70 1")
