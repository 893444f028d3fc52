"""A self-model as a Drake plant: what was learned sits in the frames of its joints."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import Frame

from nico_selfmodel.errors import ModelError, check_kind
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed, refuse_unknown
from nico_selfmodel.plant.description import ArmDescription
from nico_selfmodel.plant.frames import (
    JointFrames,
    add_frame,
    add_robot,
    check_placeable,
    frame_names,
    place_root,
)
from nico_selfmodel.plant.kinematic_tree import WORLD, KinematicTree
from nico_selfmodel.plant.learned_frames import LearnedFrames, learned_frames
from nico_selfmodel.plant.model_in_plant import (
    ModelInPlant,
    check_finite,
    check_open,
    parent_frame,
)
from nico_selfmodel.plant.urdf_document import hand_frame_name

_DESCRIBED = (
    "give ArmDescription.from_urdf of its URDF; `nico-selfmodel export-urdf` writes one of a "
    "self-model that was learned without"
)
TIME_STEP = 1e-3
"""Of a plant that is made here [s].

In continuous time one hand that falls on a plinth takes an error-controlled integrator through
50,000 steps of down to 2 ns; a discrete plant solves each contact once a step."""


@dataclass(frozen=True, eq=False)
class SelfModelPlant(ModelInPlant):
    """A robot in a plant, one arm of which is learned.

    A self-model can be written into any context. The plant's world, or the frame that the robot was
    added to, is then the measuring frame W, and the angles of the learned joints are the
    self-model's q, so that every tracked point is where `model.points(q)` has it. Held
    joints start at their values, all others at zero. The joints' limits are the description's;
    of a self-model with zeros of its own (`LearnedFrames.zeros`) they are where the links stand as
    at those of the description, to within a turn. They are of the model that the plant was built
    with.
    """

    arm: ArmDescription
    """Which chain is learned, and its nominal geometry."""
    markers: tuple[str, ...]
    """Tracked points that have frames."""
    model: SelfModel | None
    """The self-model that new contexts hold; None if they hold the description."""
    hung_frames: Mapping[str, NDArray]
    """Frames by which the robot hangs on the world, and their poses in its root."""
    scene_graph: SceneGraph | None = None
    """What the robot looks like, if a builder was given."""

    @classmethod
    def add_to(
        cls,
        plant: MultibodyPlant,
        arm: ArmDescription,
        model: SelfModel | None = None,
        *,
        name: str | None = None,
        frame: Frame | None = None,
    ) -> "SelfModelPlant":
        """Add a robot to a plant of one's own, beside whatever is in it.

        Time step, contact model and scene graph are the plant's. Frames of the tracked points are
        in a model instance of their own, `<name>::self_model`.

        Args:
            plant: It, before `Finalize()`.
            model: What new contexts hold. Without it they hold the description, and the robot's
                root link stands at the origin.
            name: Of the robot's model instance; that in its file if omitted.
            frame: The frame of the plant that is the measuring frame W; the world if omitted.

        Returns:
            The robot, with which a self-model is written into contexts.

        Raises:
            ModelError: If the plant is finalized, has a model of this name or not this frame, the
                robot has a frame that is called as one of those made here, the
                self-model has no arm or other joints, or Drake cannot read the robot. All but what
                only Drake finds (a mesh that is missing) leaves the plant as it was.
            TypeError: If there is no description, or no self-model but something else.
        """
        check_kind(arm, ArmDescription, _DESCRIBED)
        if model is not None:
            check_kind(model, SelfModel, "give a self-model; a body is in a plant by BodyPlant")
        check_open(plant)
        frames = learned_frames(arm, model.chain if model else arm.chain)
        tree = KinematicTree.from_urdf(arm.urdf)
        check_placeable(tree, arm.links.root_link)
        name = name or tree.name
        check_open(plant, name, _hands(name))
        frame = parent_frame(plant, frame)
        X_WR = frames.X_WR if model else np.eye(4)
        learned = {
            joint: JointFrames(frames.X_PF[i], frames.X_CM[i], float(frames.zeros[i]))
            for i, joint in enumerate(arm.joints)
        }
        instance, hung = add_robot(plant, tree, name, learned, frame, X_WR)
        if arm.links.root_link != WORLD:
            hung[place_root(plant, instance, arm.links.root_link, frame, X_WR)] = np.eye(4)
        tip = plant.GetFrameByName(arm.tip_link, instance)
        hands = plant.AddModelInstance(_hands(name))
        for marker, X_TH in zip(frames.markers, frames.X_TH, strict=True):
            add_frame(plant, hands, hand_frame_name(marker), tip, X_TH)
        for joint, value in arm.held.items():
            plant.GetJointByName(joint, instance).set_default_positions(np.array([value]))
        return cls(plant, instance, arm, frames.markers, model, MappingProxyType(hung))

    @classmethod
    def from_urdf(
        cls,
        arm: ArmDescription,
        model: SelfModel | None = None,
        *,
        builder: Any = None,
        scene_graph: SceneGraph | None = None,
        time_step: float = TIME_STEP,
    ) -> "SelfModelPlant":
        """Build a plant that holds the robot alone, by `add_to`.

        Args:
            model: What new contexts hold, as in `add_to`.
            builder: A `DiagramBuilder` that takes plant and scene graph; the robot's
                meshes must then be there. Without it the plant has no geometry.
            scene_graph: In place of a builder, a scene graph that the plant's geometry goes into,
                for a plant that is not part of a diagram; what moves it is up to the caller.
            time_step: Of the plant [s]; 0 for a continuous one, in which contact is slow.

        Returns:
            The plant, finalized.

        Raises:
            ModelError: If the model has other joints, or Drake cannot read the robot.
        """
        plant = MultibodyPlant(time_step)
        if builder is not None:
            plant, scene_graph = AddMultibodyPlantSceneGraph(builder, plant)
        elif scene_graph is not None:
            plant.RegisterAsSourceForSceneGraph(scene_graph)
        robot = cls.add_to(plant, arm, model)
        plant.Finalize()
        return replace(robot, scene_graph=scene_graph)

    def write(self, context: Any, model: SelfModel) -> None:
        """Write a self-model into a context; other contexts stay as they are.

        `set_positions` reads by the self-model that the plant was built with, unless it is given
        this one: give it.

        Args:
            context: The plant's context, or the root context of its diagram.
            model: The self-model; its tracked points must have frames in the plant.

        Raises:
            ModelError: If the model has other joints, or a tracked point without a frame.
        """
        frames = learned_frames(self.arm, model.chain)
        unknown = set(frames.markers) - set(self.markers)
        if unknown:
            raise ModelError(
                f"the plant has no frame for {listed(sorted(unknown))}, only for "
                f"{listed(self.markers)}: build it with this self-model"
            )
        self._write_frames(context, frames)

    def _write_frames(self, context: Any, frames: LearnedFrames) -> None:
        poses: dict[str, NDArray] = {}
        for i, joint in enumerate(self.arm.joints):
            name_F, name_M = frame_names(joint)
            poses[name_F], poses[name_M] = frames.X_PF[i], frames.X_CM[i]
        for name, X_RF in self.hung_frames.items():
            poses[name] = frames.X_WR @ poses.get(name, X_RF)
        frame_poses: list[tuple[Any, NDArray]] = [
            (self.plant.GetFrameByName(name, self.instance), pose) for name, pose in poses.items()
        ]
        frame_poses += [
            (self._hand_frame(marker), X_TH)
            for marker, X_TH in zip(frames.markers, frames.X_TH, strict=True)
        ]
        self.write_poses(context, frame_poses)

    def tracked_point_frame(self, marker: str | None = None) -> Frame:
        """Return the frame of a tracked point, the first one if none is named.

        Raises:
            ValueError: If there is no such marker; the message lists those there are.
        """
        marker = self.markers[0] if marker is None else marker
        refuse_unknown("marker", marker, self.markers)
        return self._hand_frame(marker)

    def set_positions(
        self, context: Any, readings: ArrayLike, model: SelfModel | None = None
    ) -> None:
        """Move the learned joints in a context to encoder readings; all others stay.

        Of a self-model that bends the joints go to where its own weight turns them, and the joint
        frames to where its bearings give way: the plant is then right at these readings alone.

        Args:
            context: The plant's context, or the root context of its diagram.
            readings: In the encoders' own units. Shape (n,).
            model: Whose servo map to use, and what bends: the one that was written into the
                context. The one that the plant was built with if omitted.

        Raises:
            ValueError: If `readings` is not n finite numbers, or there is no model to read them
                with.
            ModelError: If the model has other joints.
        """
        model, q = self._joint_angles(readings, model)
        posture = model.posture(q)
        if posture.bearings is not None:
            frames = learned_frames(self.arm, model.chain)
            X_WN = model.dh.frames(np.zeros(len(q)))[:-1]
            self._write_frames(context, frames.given_way(X_WN, posture.bearings))
        self.set_joint_angles(context, posture.q)

    def set_joint_angles(self, context: Any, q: ArrayLike) -> None:
        """Move the learned joints in a context to angles q [rad], shape (n,); all others stay.

        Raises:
            ValueError: If `q` is not n numbers.
        """
        q = np.asarray(q)
        if q.shape != (len(self.arm.joints),):
            raise ValueError(f"q must have shape ({len(self.arm.joints)},), got {q.shape}")
        self.move_joints(context, self.arm.joints, q)

    @property
    def columns(self) -> NDArray:
        """Where each learned joint stands among the plant's positions. Shape (n,)."""
        return self.columns_of(self.arm.joints)

    def _joint_angles(
        self, readings: ArrayLike, model: SelfModel | None
    ) -> tuple[SelfModel, NDArray]:
        model = self.model if model is None else model
        if model is None:
            raise ValueError("the plant was built without a self-model: give the one to read with")
        self.arm.check_joints(model.joints)
        readings = np.asarray(readings)
        if readings.shape != (len(self.arm.joints),):
            raise ValueError(
                f"readings must have shape ({len(self.arm.joints)},), got {readings.shape}"
            )
        check_finite(self.arm.joints, readings)
        return model, model.servos.to_joint(readings)

    def _hand_frame(self, marker: str) -> Any:
        hands = self.plant.GetModelInstanceByName(_hands(self.name))
        return self.plant.GetFrameByName(hand_frame_name(marker), hands)


def _hands(name: str) -> str:
    """Return the model instance of the frames of a robot's tracked points."""
    return f"{name}::self_model"
