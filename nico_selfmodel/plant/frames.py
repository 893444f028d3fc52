"""Plants whose joints stand on frames of our own, so that a context can move them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    Frame,
    Joint,
    ModelInstanceIndex,
    RevoluteJoint,
    WeldJoint,
)

from nico_selfmodel.errors import ModelError
from nico_selfmodel.plant.kinematic_tree import WORLD, rigid, robot_joints


@dataclass(frozen=True, eq=False)
class JointFrames:
    """Poses of a joint's two frames; the joint's axis is z of both."""

    X_PF: NDArray
    """On the parent link; on the robot's root link where that is the world. Shape (4, 4)."""
    X_CM: NDArray
    """On the child link. Shape (4, 4)."""


def frame_names(joint: str) -> tuple[str, str]:
    """Return the names of a joint's frames on its parent and on its child link."""
    return f"{joint}_F", f"{joint}_M"


def put_joints_on_own_frames(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    learned: Mapping[str, JointFrames],
    X_WR: NDArray,
) -> dict[str, NDArray]:
    """Rebuild every revolute joint of a parsed robot between two frames made here.

    Which frames Drake's parser makes differs by version and by the joint's origin, and a
    context can only move frames that are there. Limits, damping, default angles and motors are
    kept. Constraints are not (Drake removes no joint of a plant that has any): joints that
    mimic others then move on their own.

    Args:
        plant: A plant that is not finalized, with the robot just parsed.
        instance: The robot.
        learned: Frames of joints that shall not stand where the file has them.
        X_WR: Pose of the robot's root in the world. Shape (4, 4).

    Returns:
        For each frame that hangs on the world, its pose in the robot's root: these frames carry
        X_WR.

    Raises:
        ModelError: If the robot has a bushing, or hangs on the world by another kind of joint.
    """
    if plant.num_force_elements() > 1:  # gravity is one
        raise ModelError("the URDF has a bushing: Drake cannot move the joints of such a robot")
    for identifier in plant.GetConstraintIds():
        plant.RemoveConstraint(identifier)
    motors = _remove_motors(plant)
    on_world: dict[str, NDArray] = {}
    for joint in robot_joints(plant, instance):
        hangs_on_world = joint.parent_body().name() == WORLD
        if isinstance(joint, RevoluteJoint):
            poses = learned.get(joint.name()) or _nominal_frames(joint)
        elif hangs_on_world and isinstance(joint, WeldJoint):
            poses = _frames_as_parsed(joint)
        elif hangs_on_world:
            raise ModelError(
                f"joint {joint.name()!r} to the world is {joint.type_name()}: only fixed and "
                "revolute joints can carry a robot that is to be placed"
            )
        else:
            continue
        if hangs_on_world:
            on_world[frame_names(joint.name())[0]] = poses.X_PF
            poses = JointFrames(X_WR @ poses.X_PF, poses.X_CM)
        _rebuild(plant, instance, joint, poses)
    for motor in motors:
        _add_motor(plant, instance, motor)
    return on_world


def place_root(
    plant: MultibodyPlant, instance: ModelInstanceIndex, root: str, X_WR: NDArray
) -> str:
    """Weld a root link to a frame on the world, so that a context can place the robot.

    Returns:
        The frame's name.
    """
    name = f"{root}_placement"
    frame = plant.AddFrame(FixedOffsetFrame(name, plant.world_frame(), rigid(X_WR), instance))
    plant.WeldFrames(frame, plant.GetFrameByName(root, instance))
    return name


def _frames_as_parsed(joint: Joint) -> JointFrames:
    parent, child = joint.frame_on_parent(), joint.frame_on_child()
    return JointFrames(
        np.asarray(parent.GetFixedPoseInBodyFrame().GetAsMatrix4()),
        np.asarray(child.GetFixedPoseInBodyFrame().GetAsMatrix4()),
    )


def _nominal_frames(joint: RevoluteJoint) -> JointFrames:
    """Return the joint's frames as parsed, both turned so that z is the axis."""
    parsed = _frames_as_parsed(joint)
    z = joint.revolute_axis()
    turn = np.eye(4)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    turn[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return JointFrames(parsed.X_PF @ turn, parsed.X_CM @ turn)


def _rebuild(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    old: RevoluteJoint | WeldJoint,
    poses: JointFrames,
) -> None:
    parent, child = old.parent_body().body_frame(), old.child_body().body_frame()
    name_F, name_M = frame_names(old.name())
    F = plant.AddFrame(FixedOffsetFrame(name_F, parent, rigid(poses.X_PF), instance))
    M = plant.AddFrame(FixedOffsetFrame(name_M, child, rigid(poses.X_CM), instance))
    joint = _revolute_like(old, F, M) if isinstance(old, RevoluteJoint) else _weld_like(old, F, M)
    plant.RemoveJoint(old)
    plant.AddJoint(joint)


def _revolute_like(old: RevoluteJoint, F: Frame, M: Frame) -> RevoluteJoint:
    joint = RevoluteJoint(old.name(), F, M, [0.0, 0.0, 1.0], old.default_damping())
    joint.set_position_limits(old.position_lower_limits(), old.position_upper_limits())
    joint.set_velocity_limits(old.velocity_lower_limits(), old.velocity_upper_limits())
    joint.set_acceleration_limits(old.acceleration_lower_limits(), old.acceleration_upper_limits())
    joint.set_default_angle(old.get_default_angle())
    return joint


def _weld_like(old: WeldJoint, F: Frame, M: Frame) -> WeldJoint:
    return WeldJoint(old.name(), F, M, old.X_FM())


@dataclass(frozen=True, eq=False)
class _Motor:
    """What has to be kept of an actuator while its joint is rebuilt."""

    name: str
    joint: str
    effort_limit: float
    gear_ratio: float
    rotor_inertia: float


def _remove_motors(plant: MultibodyPlant) -> list[_Motor]:
    motors = []
    # The indices of one instance are an empty list until Finalize().
    for index in plant.GetJointActuatorIndices():
        actuator = plant.get_joint_actuator(index)
        motors.append(
            _Motor(
                actuator.name(),
                actuator.joint().name(),
                actuator.effort_limit(),
                actuator.default_gear_ratio(),
                actuator.default_rotor_inertia(),
            )
        )
        plant.RemoveJointActuator(actuator)
    return motors


def _add_motor(plant: MultibodyPlant, instance: ModelInstanceIndex, motor: _Motor) -> None:
    joint = plant.GetJointByName(motor.joint, instance)
    actuator = plant.AddJointActuator(motor.name, joint, motor.effort_limit)
    actuator.set_default_gear_ratio(motor.gear_ratio)
    actuator.set_default_rotor_inertia(motor.rotor_inertia)
