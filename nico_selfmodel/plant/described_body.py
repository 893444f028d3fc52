"""A robot description as the tree of joints that a recording lists."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.tree import Joint

from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.errors import ModelError
from nico_selfmodel.geometry.rotation import frame_along
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.tree.body_tree import FLANGE, FREE, WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.plant.described_links import axis_of
from nico_selfmodel.plant.described_structure import check_structure
from nico_selfmodel.plant.kinematic_tree import KinematicTree


def described_body(urdf: Path, joints: Sequence[LinkJoint], blank: BodyTree) -> BodyTree:
    """Return a recording's body where a description puts it, in the frame of the robot's root.

    Joints of the description that the recording does not list stand at zero. Markers and sensors
    stand where the description has a link or frame of their name; a marker of which it says nothing
    stands at its link's origin.

    Args:
        joints: Those of the recording; they are called as the description's.
        blank: The body to fill in.

    Raises:
        ModelError: If a joint is not described, moves otherwise, or hangs on or follows another.
    """
    described = KinematicTree.from_urdf(urdf)
    if len(described.roots) != 1:
        raise ModelError(
            f"{urdf} has {len(described.roots)} roots {listed(described.roots)}, not 1"
        )
    root = described.roots[0]
    X_WL = {WORLD: np.eye(4)}
    X_PJ = np.array(blank.X_PJ)
    for i, joint in enumerate(joints):
        if joint.motion == FLANGE:
            raise ModelError(
                f"joint {joint.name!r} is a flange, whose whole pose is read: leave --robot out"
            )
        if joint.motion == FREE:  # no part of the robot
            continue
        X_WL[i] = _axis_frame(described, root, described.joint(joint.name), joint.motion)
        X_PJ[i] = inverse(X_WL[int(blank.parent[i])]) @ X_WL[i]
    check_structure(described, joints)

    def placed(name: str, on: int, X_old: NDArray) -> NDArray:
        if on not in X_WL or not described.plant.HasFrameNamed(name, described.instance):
            return X_old
        X_WF = described.poses({}, root, [described.frame(name)])[0]
        return inverse(X_WL[on]) @ X_WF

    markers = tuple(replace(m, X_LA=placed(m.name, m.on, m.X_LA)) for m in blank.markers)
    sensors = tuple(replace(s, X_LA=placed(s.name, s.on, s.X_LA)) for s in blank.sensors)
    return replace(blank, X_PJ=X_PJ, markers=markers, sensors=sensors)


def described_masses(urdf: Path, body: BodyTree) -> tuple[NDArray, NDArray] | None:
    """Return what each link weighs, with all that stands still on it.

    Args:
        body: Where it puts a recording's body, `described_body`.

    Returns:
        Masses [kg], shape (n,), and their centres on the links [m], shape (n, 3); None where the
        description has none.
    """
    described = KinematicTree.from_urdf(urdf)
    plant, root = described.plant, described.roots[0]
    still = TreeMotion.at(body, np.zeros((1, len(body.joints))))
    index = {name: i for i, name in enumerate(body.joints)}
    mass, moment = np.zeros(len(index)), np.zeros((len(index), 3))
    for link in plant.GetBodyIndices(described.instance):
        part = plant.get_body(link)
        names = [joint.name() for joint in described.joints_down_to(part.name())]
        carriers = [index[name] for name in names if name in index]
        if not carriers or not part.default_mass() > 0.0:
            continue
        i, own = carriers[-1], part.default_spatial_inertia()
        X_WB = described.poses({}, root, [part.body_frame()])[0]
        X_WL = transform(still.R_WL[i, :, :, 0], still.p_WL[i, :, 0])
        mass[i] += own.get_mass()
        moment[i] += own.get_mass() * apply(inverse(X_WL) @ X_WB, own.get_com())
    if not mass.any():
        return None
    return mass, moment / np.maximum(mass, np.finfo(float).tiny)[:, None]


def _axis_frame(described: KinematicTree, root: str, joint: Joint, motion: str) -> NDArray:
    """Return a joint's frame in the root's at zero, with z along its axis. Shape (4, 4)."""
    turn = frame_along(axis_of(described, joint, motion))
    X_WF = described.poses({}, root, [joint.frame_on_parent()])[0]
    return X_WF @ transform(turn, np.zeros(3))
