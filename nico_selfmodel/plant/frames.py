"""Robots whose joints stand on frames of our own, so that a context can move them.

Which frames Drake's parser makes differs by version and by the joint's origin, and a context can
only move frames that are there. So the parser reads a robot's links, and its joints are made here:
nothing has to be removed from a plant, whatever else is in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from xml.dom.minidom import Element

import numpy as np
from numpy.typing import NDArray
from pydrake.autodiffutils import AutoDiffXd
from pydrake.multibody.plant import DiscreteContactSolver, MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    Joint,
    ModelInstanceIndex,
    RevoluteJoint,
    WeldJoint,
)
from pydrake.symbolic import Expression

from nico_selfmodel.errors import ModelError
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.plant.kinematic_tree import WORLD, KinematicTree, parse, rigid
from nico_selfmodel.plant.urdf_document import (
    child,
    children,
    document_text,
    lead_files,
    read_document,
    robot_element,
)

_TINY = 1e-300
"""Shift of a frame [m] that no sum notices, and which makes its pose not exactly the identity."""


@dataclass(frozen=True, eq=False)
class JointFrames:
    """Poses of a joint's two frames; the joint's axis is z of both."""

    X_PF: NDArray
    """On the parent link; on the robot's root link where that is the world. Shape (4, 4)."""
    X_CM: NDArray
    """On the child link. Shape (4, 4)."""
    zero: float = 0.0
    """What is added to the joint's angle to have that of its file [rad]."""


def movable_pose(pose: NDArray) -> NDArray:
    """Return a pose that derivatives can pass. Shape (4, 4).

    Drake (1.51) leaves frames out of its products whose pose is exactly the identity, and with the
    value the derivatives by that pose, silently.
    """
    values = [x.value() if isinstance(x, AutoDiffXd) else x for x in pose.flat]
    if not any(isinstance(x, Expression) for x in values) and values == np.eye(4).ravel().tolist():
        pose = pose.copy()
        pose[2, 3] = pose[2, 3] + _TINY
    return pose


def frame_names(joint: str) -> tuple[str, str]:
    """Return the names of a joint's frames on its parent and on its child link."""
    return f"{joint}_F", f"{joint}_M"


def check_placeable(tree: KinematicTree, root: str) -> None:
    """Refuse a robot that hangs on the world by a joint that cannot be moved to where it stands.

    Args:
        root: The link that is placed.

    Raises:
        ModelError: If it is neither fixed nor revolute, or a frame is called as one made here.
    """
    made = {name for joint in _ours(tree) for name in frame_names(joint)} | {_placement(root)}
    taken = sorted(made & {frame.name() for frame in tree.frames})
    if taken:
        raise ModelError(
            f"{tree.urdf} has a frame {taken[0]!r}, as one that is made for a joint or the root: "
            "rename it"
        )
    for joint in tree.joint_above.values():
        fit = isinstance(joint, RevoluteJoint | WeldJoint)
        if joint.parent_body().name() == WORLD and not fit:
            raise ModelError(
                f"joint {joint.name()!r} to the world is {joint.type_name()}: only fixed and "
                "revolute joints can carry a robot that is to be placed"
            )


def add_robot(
    plant: MultibodyPlant,
    tree: KinematicTree,
    name: str,
    learned: Mapping[str, JointFrames],
    parent: Frame,
    X_PR: NDArray,
) -> tuple[ModelInstanceIndex, dict[str, NDArray]]:
    """Add a robot, every revolute joint of it between two frames made here.

    Limits, damping, default angles, motors and mimicked joints are those of the file.

    Args:
        plant: A plant that is not finalized.
        tree: The robot as its file describes it.
        learned: Frames of joints that shall not stand where the file has them.
        parent: A frame P of the plant.
        X_PR: Pose of the robot's root, or of what its file calls the world, in P. Shape (4, 4).

    Returns:
        The instance, and for each frame by which the robot hangs on P, its pose in the robot's
        root: these frames carry X_PR.

    Raises:
        ModelError: If Drake cannot read the robot.
    """
    ours = _ours(tree)
    text, followers = _without_joints(tree, name, set(ours))
    instance = parse(plant, tree.urdf, text)
    hung: dict[str, NDArray] = {}
    for joint in ours.values():
        poses = _frames_as_parsed(joint)
        if isinstance(joint, RevoluteJoint):
            poses = learned.get(joint.name()) or _turned_to_z(joint, poses)
        body: Frame = parent
        if joint.parent_body().name() == WORLD:
            hung[frame_names(joint.name())[0]] = poses.X_PF
            poses = replace(poses, X_PF=X_PR @ poses.X_PF)
        else:
            body = plant.GetFrameByName(joint.parent_body().name(), instance)
        _add_joint(plant, instance, joint, body, poses)
    _add_motors(plant, instance, tree.plant)
    zeros = {name: poses.zero for name, poses in learned.items()}
    _add_followers(plant, instance, [one.counted_from(zeros) for one in followers])
    return instance, hung


def _ours(tree: KinematicTree) -> dict[str, Joint]:
    """Return the joints, by name, that are made anew."""
    return {
        joint.name(): joint
        for joint in tree.joint_above.values()
        if isinstance(joint, RevoluteJoint) or joint.parent_body().name() == WORLD
    }


def _placement(root: str) -> str:
    """Return the name of the frame on which a root link is placed."""
    return f"{root}_placement"


def place_root(
    plant: MultibodyPlant, instance: ModelInstanceIndex, root: str, parent: Frame, X_PR: NDArray
) -> str:
    """Weld a root link to a frame on P, so that a context can place the robot.

    Returns:
        The frame's name.
    """
    name = _placement(root)
    frame = add_frame(plant, instance, name, parent, X_PR)
    plant.WeldFrames(frame, plant.GetFrameByName(root, instance))
    return name


def add_frame(
    plant: MultibodyPlant, instance: ModelInstanceIndex, name: str, parent: Frame, pose: NDArray
) -> Frame:
    """Add a frame that a context can move. The pose has shape (4, 4)."""
    return plant.AddFrame(FixedOffsetFrame(name, parent, rigid(movable_pose(pose)), instance))


def _without_joints(
    tree: KinematicTree, name: str, without: set[str]
) -> tuple[str, list["_Follower"]]:
    """Return a robot's file without some joints and all motors, and who followed those joints."""
    document = read_document(tree.urdf)
    robot = robot_element(document)
    robot.setAttribute("name", name)
    lead_files(robot, lambda file: str(real_path(tree.urdf.parent / file)))
    followers: list[_Follower] = []
    for joint in children(robot, "joint"):
        own, mimic = joint.getAttribute("name"), child(joint, "mimic")
        if mimic is not None and {own, mimic.getAttribute("joint")} & without:
            followers.append(_Follower.from_mimic(own, mimic))
            joint.removeChild(mimic)
        if own in without:
            robot.removeChild(joint)
    for transmission in children(robot, "transmission"):
        robot.removeChild(transmission)
    return document_text(document), followers


@dataclass(frozen=True)
class _Follower:
    """A joint that follows another one, q = gear q_leader + offset."""

    name: str
    leader: str
    gear: float
    offset: float

    @classmethod
    def from_mimic(cls, name: str, mimic: Element) -> "_Follower":
        gear, offset = (mimic.getAttribute(key) for key in ("multiplier", "offset"))
        return cls(name, mimic.getAttribute("joint"), float(gear or 1.0), float(offset or 0.0))

    def counted_from(self, zeros: Mapping[str, float]) -> "_Follower":
        """Return the same of a leader whose angle is counted from another zero [rad]."""
        return replace(self, offset=self.offset + self.gear * zeros.get(self.leader, 0.0))


def _add_followers(
    plant: MultibodyPlant, instance: ModelInstanceIndex, followers: list[_Follower]
) -> None:
    for follower in followers:
        joint, leader = (
            plant.GetJointByName(name, instance) for name in (follower.name, follower.leader)
        )
        couple(plant, joint, leader, follower.gear, follower.offset)


def couple(
    plant: MultibodyPlant, joint: Joint, leader: Joint, gear: float, offset: float = 0.0
) -> None:
    """Couple two joints as the parser does, q = gear q_leader + offset, where the solver can."""
    by_sap = plant.get_discrete_contact_solver() == DiscreteContactSolver.kSap
    if plant.time_step() != 0.0 and by_sap:
        plant.AddCouplerConstraint(joint, leader, gear, offset)


def _frames_as_parsed(joint: Joint) -> JointFrames:
    parent, child_frame = joint.frame_on_parent(), joint.frame_on_child()
    return JointFrames(
        np.asarray(parent.GetFixedPoseInBodyFrame().GetAsMatrix4()),
        np.asarray(child_frame.GetFixedPoseInBodyFrame().GetAsMatrix4()),
    )


def _turned_to_z(joint: RevoluteJoint, parsed: JointFrames) -> JointFrames:
    """Return the joint's frames as parsed, both turned so that z is the axis."""
    z = joint.revolute_axis()
    turn = np.eye(4)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    turn[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return JointFrames(parsed.X_PF @ turn, parsed.X_CM @ turn)


def _add_joint(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    old: Joint,
    parent: Frame,
    poses: JointFrames,
) -> None:
    name_F, name_M = frame_names(old.name())
    body = plant.GetFrameByName(old.child_body().name(), instance)
    F = add_frame(plant, instance, name_F, parent, poses.X_PF)
    M = add_frame(plant, instance, name_M, body, poses.X_CM)
    if isinstance(old, RevoluteJoint):
        plant.AddJoint(_revolute_like(old, F, M, poses.zero))
    elif isinstance(old, WeldJoint):
        plant.AddJoint(WeldJoint(old.name(), F, M, old.X_FM()))


def _revolute_like(old: RevoluteJoint, F: Frame, M: Frame, zero: float) -> RevoluteJoint:
    joint = RevoluteJoint(old.name(), F, M, [0.0, 0.0, 1.0], old.default_damping())
    low, high = old.position_lower_limits(), old.position_upper_limits()
    joint.set_position_limits(np.subtract(low, zero), np.subtract(high, zero))
    joint.set_velocity_limits(old.velocity_lower_limits(), old.velocity_upper_limits())
    joint.set_acceleration_limits(old.acceleration_lower_limits(), old.acceleration_upper_limits())
    joint.set_default_angle(old.get_default_angle())
    return joint


def _add_motors(
    plant: MultibodyPlant, instance: ModelInstanceIndex, parsed: MultibodyPlant
) -> None:
    """Add a robot's motors in the order of its file."""
    for index in parsed.GetJointActuatorIndices():
        old = parsed.get_joint_actuator(index)
        joint = plant.GetJointByName(old.joint().name(), instance)
        motor = plant.AddJointActuator(old.name(), joint, old.effort_limit())
        motor.set_default_gear_ratio(old.default_gear_ratio())
        motor.set_default_rotor_inertia(old.default_rotor_inertia())
        if old.has_controller():
            motor.set_controller_gains(old.get_controller_gains())
