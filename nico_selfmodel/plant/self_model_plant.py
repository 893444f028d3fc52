"""A self-model as a Drake plant: what was learned sits in the frames of its joints."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, Frame, ModelInstanceIndex

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.plant.description import ArmDescription
from nico_selfmodel.plant.frames import (
    JointFrames,
    frame_names,
    place_root,
    put_joints_on_own_frames,
)
from nico_selfmodel.plant.kinematic_tree import WORLD, parse_urdf, rigid
from nico_selfmodel.plant.learned_frames import LearnedFrames, learned_frames

INSTANCE = "self_model"
"""Model instance of the frames of the tracked points."""


@dataclass(frozen=True, eq=False)
class SelfModelPlant:
    """A finalized continuous plant of a whole robot, one arm of which is learned.

    A self-model can be written into any context. The plant's world is then the measuring frame W,
    and the angles of the learned joints are the self-model's q, so that every tracked point is
    where `model.chain.forward(q)` has it. Held joints start at their values, all others at zero.
    The joints' limits are the description's: they fit a self-model whose zeros are the robot's.
    """

    plant: MultibodyPlant
    """The robot."""
    instance: ModelInstanceIndex
    """The robot's model instance."""
    arm: ArmDescription
    """Which chain is learned, and its nominal geometry."""
    markers: tuple[str, ...]
    """Tracked points that have frames."""
    model: SelfModel | None
    """The self-model that new contexts hold; None if they hold the description."""
    scene_graph: SceneGraph | None
    """What the robot looks like, if a builder was given."""
    on_world: Mapping[str, NDArray]
    """Frames by which the robot hangs on the world, and their poses in its root."""

    @classmethod
    def from_urdf(
        cls,
        arm: ArmDescription,
        model: SelfModel | None = None,
        *,
        builder: Any = None,
        scene_graph: SceneGraph | None = None,
    ) -> "SelfModelPlant":
        """Build the plant.

        Args:
            arm: The robot and the chain.
            model: What new contexts hold. Without it they hold the description, and the
                robot's root link stands at the world's origin.
            builder: A `DiagramBuilder` that takes plant and scene graph; the robot's
                meshes must then be there. Without it the plant has no geometry.
            scene_graph: In place of a builder, a scene graph that the plant's geometry goes into,
                for a plant that is not part of a diagram; what moves it is up to the caller.

        Returns:
            The plant, finalized.

        Raises:
            ModelError: If the model has other joints, or Drake cannot read the robot.
        """
        plant = MultibodyPlant(0.0)
        if builder is not None:
            plant, scene_graph = AddMultibodyPlantSceneGraph(builder, plant)
        elif scene_graph is not None:
            plant.RegisterAsSourceForSceneGraph(scene_graph)
        instance = parse_urdf(arm.urdf, plant)
        frames = learned_frames(arm, model.chain if model else arm.chain)
        X_WR = frames.X_WR if model else np.eye(4)
        learned = {
            joint: JointFrames(frames.X_PF[i], frames.X_CM[i]) for i, joint in enumerate(arm.joints)
        }
        on_world = put_joints_on_own_frames(plant, instance, learned, X_WR)
        if arm.links.root_link != WORLD:
            on_world[place_root(plant, instance, arm.links.root_link, X_WR)] = np.eye(4)
        tip = plant.GetFrameByName(arm.tip_link, instance)
        hands = plant.AddModelInstance(INSTANCE)
        for marker, X_TH in zip(frames.markers, frames.X_TH, strict=True):
            plant.AddFrame(FixedOffsetFrame(hand_frame_name(marker), tip, rigid(X_TH), hands))
        for joint, value in arm.held.items():
            plant.GetJointByName(joint, instance).set_default_positions(np.array([value]))
        plant.Finalize()
        frozen = MappingProxyType(on_world)
        return cls(plant, instance, arm, frames.markers, model, scene_graph, frozen)

    def write(self, context: Any, model: SelfModel) -> None:
        """Write a self-model into a context; other contexts stay as they are.

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
        self._write_frames(self.own_context(context), frames)

    def _write_frames(self, context: Any, frames: LearnedFrames) -> None:
        poses: dict[str, NDArray] = {}
        for i, joint in enumerate(self.arm.joints):
            name_F, name_M = frame_names(joint)
            poses[name_F], poses[name_M] = frames.X_PF[i], frames.X_CM[i]
        for name, X_RF in self.on_world.items():
            poses[name] = frames.X_WR @ poses.get(name, X_RF)
        for name, pose in poses.items():
            self._joint_frame(name).SetPoseInParentFrame(context, rigid(pose))
        for marker, X_TH in zip(frames.markers, frames.X_TH, strict=True):
            self._hand_frame(marker).SetPoseInParentFrame(context, rigid(X_TH))

    def own_context(self, context: Any) -> Any:
        """Return the plant's part of a root context; the plant's own context as it is.

        Raises:
            ValueError: If the context belongs neither to the plant nor to its diagram.
        """
        for find in (lambda: context, lambda: self.plant.GetMyMutableContextFromRoot(context)):
            try:
                own = find()
                self.plant.ValidateContext(own)
            except RuntimeError:
                continue
            return own
        raise ValueError("context belongs to another plant or diagram")

    def tracked_point_frame(self, marker: str | None = None) -> Frame:
        """Return the frame of a tracked point, the first one if none is named.

        Raises:
            ValueError: If there is no such marker; the message lists those there are.
        """
        marker = self.markers[0] if marker is None else marker
        if marker not in self.markers:
            raise ValueError(f"no marker {marker!r}; the plant has {listed(self.markers, marker)}")
        return self._hand_frame(marker)

    def set_positions(
        self, context: Any, readings: ArrayLike, model: SelfModel | None = None
    ) -> None:
        """Move the learned joints in a context to encoder readings; all others stay.

        Args:
            context: The plant's context, or the root context of its diagram.
            readings: In the encoders' own units. Shape (n,).
            model: Whose servo map to use; the plant's own if omitted.

        Raises:
            ValueError: If `readings` is not n numbers, or there is no model to read them with.
            ModelError: If the model has other joints.
        """
        self.set_joint_angles(context, self._joint_angles(readings, model))

    def set_joint_angles(self, context: Any, q: ArrayLike) -> None:
        """Move the learned joints in a context to angles q [rad], shape (n,); all others stay.

        Raises:
            ValueError: If `q` is not n numbers.
        """
        q = np.asarray(q, dtype=float)
        if q.shape != (len(self.arm.joints),):
            raise ValueError(f"q must have shape ({len(self.arm.joints)},), got {q.shape}")
        context = self.own_context(context)
        positions = self.plant.GetPositions(context).copy()
        positions[self.columns] = q
        self.plant.SetPositions(context, positions)

    @property
    def columns(self) -> NDArray:
        """Where each learned joint stands among the plant's positions. Shape (n,)."""
        joints = [self.plant.GetJointByName(name, self.instance) for name in self.arm.joints]
        return np.array([joint.position_start() for joint in joints])

    def _joint_angles(self, readings: ArrayLike, model: SelfModel | None) -> NDArray:
        model = self.model if model is None else model
        if model is None:
            raise ValueError("the plant was built without a self-model: give the one to read with")
        self.arm.check_joints(model.joints)
        readings = np.asarray(readings, dtype=float)
        if readings.shape != (len(self.arm.joints),):
            raise ValueError(
                f"readings must have shape ({len(self.arm.joints)},), got {readings.shape}"
            )
        return model.servos.to_joint(readings)

    def _joint_frame(self, name: str) -> FixedOffsetFrame:
        return _movable(self.plant.GetFrameByName(name, self.instance))

    def _hand_frame(self, marker: str) -> FixedOffsetFrame:
        hands = self.plant.GetModelInstanceByName(INSTANCE)
        return _movable(self.plant.GetFrameByName(hand_frame_name(marker), hands))


def _movable(frame: Frame) -> FixedOffsetFrame:
    assert isinstance(frame, FixedOffsetFrame)
    return frame


def hand_frame_name(marker: str) -> str:
    """Return the name of a tracked point's frame, in the plant and in an exported URDF."""
    return f"hand_{marker}"
