"""Frames of links as a description has them, and as a body has them: z is the joint's axis there.

Both have one origin, and are one where the described axis is 0 0 1.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.tree import Joint, PrismaticJoint, RevoluteJoint

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import PLANE
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import frame_along
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE
from nico_selfmodel.names import listed
from nico_selfmodel.plant.kinematic_tree import KinematicTree

_KINDS = {REVOLUTE: RevoluteJoint, PRISMATIC: PrismaticJoint}
_SAME = 1e-9
"""Sine of an angle between axes that is rounding."""
_PARTS = ("rx", "ry", "rz", "x", "y", "z")
"""Parts of a marker or sensor that are told in the frame of its link."""


def axis_of(described: KinematicTree, joint: Joint, motion: str) -> NDArray:
    """Return a joint's axis in the frame of its link. Shape (3,).

    Raises:
        ModelError: If it moves otherwise.
    """
    if not isinstance(joint, _KINDS[motion]):
        raise ModelError(
            f"joint {joint.name()!r} is {joint.type_name()} in {described.urdf}, the data set says "
            f"{motion}"
        )
    assert isinstance(joint, RevoluteJoint | PrismaticJoint)
    if isinstance(joint, RevoluteJoint):
        return np.asarray(joint.revolute_axis())
    return np.asarray(joint.translation_axis())


def turned_links(urdf: Path, joints: Sequence[LinkJoint]) -> dict[str, NDArray]:
    """Return how the body's frames are turned on described links whose axis is not 0 0 1, by name.

    Args:
        joints: Those of a recording; they are called as the description's.

    Raises:
        ModelError: If a joint is not described, or moves otherwise.
    """
    described = KinematicTree.from_urdf(urdf)
    axes = {
        joint.name: axis_of(described, described.joint(joint.name), joint.motion)
        for joint in joints
        if joint.motion in _KINDS
    }
    return {
        name: frame_along(axis)
        for name, axis in axes.items()
        if axis[2] < 0.0 or np.hypot(*axis[:2]) > _SAME
    }


def in_joint_frames(data: BodyDataset, turned: Mapping[str, NDArray]) -> BodyDataset:
    """Return a recording that tells places on described links in the frames of the body.

    Args:
        data: It tells places of markers (`xyz`) and poses of sensors in the description's frames.
        turned: Of `turned_links`.
    """

    def placed(p: tuple[float, float, float], on: str) -> tuple[float, float, float]:
        x, y, z = (turned[on].T @ p).tolist()
        return x, y, z

    markers = tuple(
        m if m.xyz is None or m.on not in turned else replace(m, xyz=placed(m.xyz, m.on))
        for m in data.markers
    )
    sensors = tuple(
        s
        if s.X_LS is None or s.on not in turned
        else replace(s, X_LS=transform(turned[s.on].T, np.zeros(3)) @ s.X_LS)
        for s in data.sensors
    )
    return replace(data, markers=markers, sensors=sensors)


def refuse_parts_on_turned(
    data: BodyDataset, turned: Mapping[str, NDArray], told: Collection[str]
) -> None:
    """Refuse to be told parts of what such links carry: whose frame is meant nobody can know.

    Args:
        turned: Of `turned_links`.
        told: Names of parameters whose values are told.

    Raises:
        ValueError: If some are; it names them.
    """
    # Parts of a plane are told from its own pose.
    for item in (*data.markers, *(s for s in data.sensors if s.kind != PLANE)):
        own = sorted({f"{item.name}.{part}" for part in _PARTS} & set(told))
        if own and item.on in turned:
            x, y, z = (turned[item.on][:, 2].round(3) + 0.0).tolist()
            raise ValueError(
                f"{listed(own)}: told on the link of {item.on!r}, whose axis is {x:g} {y:g} {z:g} "
                "in the description, a part is of another frame in the result, where z is the "
                "axis: tell a marker's 'xyz' in dataset.yaml, which are in the description's, or "
                "turn that link's frame so that its axis is 0 0 1"
            )
