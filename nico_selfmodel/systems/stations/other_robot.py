"""A second robot before a simulated one: of the same make, moved by whoever commands it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import FrameId, FramePoseVector, SceneGraph
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem

from nico_selfmodel.plant.model_in_plant import ModelInPlant
from nico_selfmodel.systems.rendering.station_scene import BodyPoses
from nico_selfmodel.systems.simulated.encoder_model import EncoderModel
from nico_selfmodel.systems.stations.nico_instance import NicoInstance
from nico_selfmodel.systems.stations.whole_nico import WholeNico

OTHER = "other/"
"""What names of its links begin with, for who paints it."""
_AWAY = RigidTransform(p=[0.0, 0.0, -70.0])
"""Where a robot is that nobody has put anywhere."""


class OtherRobot(LeafSystem):
    """Where a second robot stands, or that it is away.

    | port | | carries |
    |---|---|---|
    | `body_pose` | in | poses of its bodies as if it stood at the origin |
    | `geometry_pose` | out | poses of its bodies for the scene graph |
    """

    def __init__(self, frames: Sequence[FrameId]) -> None:
        """Take the frames of its bodies in the scene graph, and put it away."""
        super().__init__()
        self._frames = tuple(frames)
        self._standing = self.DeclareAbstractState(AbstractValue.Make(_AWAY))
        self._body = self.DeclareAbstractInputPort(
            "body_pose", AbstractValue.Make(FramePoseVector())
        )
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            self._tell,
            {self.all_state_ticket(), self._body.ticket()},
        )

    def stand(self, context: Context, X_WO: NDArray | None) -> None:
        """Let it stand at a pose, None to put it away. Shape (4, 4)."""
        pose = _AWAY if X_WO is None else RigidTransform(pose=np.asarray(X_WO, dtype=float))
        context.SetAbstractState(self._standing, pose)

    def _tell(self, context: Context, value: AbstractValue) -> None:
        X_WO = context.get_abstract_state(self._standing).get_value()
        body: Any = self._body.Eval(context)
        poses = FramePoseVector()
        for frame in self._frames:
            poses.set_value(frame, X_WO @ body.value(frame))
        value.set_value(poses)


def add_other_robot(
    builder: DiagramBuilder,
    scene_graph: SceneGraph,
    body: NicoInstance | WholeNico,
    seed: tuple[int, int],
) -> tuple[OtherRobot, ModelInPlant]:
    """Add a second robot to a station, away, with servos of its own.

    It is built exactly like the first one, so that the same commands move it alike; only what is
    left to chance differs. Its servos are commanded through the diagram's input
    `other_commanded`, in the first robot's encoder units.

    Args:
        builder: Of the station.
        scene_graph: What the station's cameras see.
        body: The first robot.

    Returns:
        The system that says where it stands, and the robot in the scene graph.
    """
    built = body.in_scene(scene_graph)
    start = body.mechanics.servos.to_encoder(np.zeros(len(body.mechanics.joints)))
    servos = EncoderModel(body.mechanics, start, seed=(*seed, 31))
    poses = BodyPoses(built, body.held, body.mechanics)
    source = built.plant.get_source_id()
    other = OtherRobot(scene_graph.model_inspector().FramesForSource(source))
    builder.AddNamedSystem("other_servos", servos)
    builder.AddNamedSystem("other_poses", poses)
    builder.AddNamedSystem("other_robot", other)
    builder.Connect(servos.GetOutputPort("q_true"), poses.get_input_port())
    builder.Connect(poses.GetOutputPort("geometry_pose"), other.get_input_port())
    builder.Connect(other.get_output_port(), scene_graph.get_source_pose_port(source))
    builder.ExportInput(servos.GetInputPort("encoders_commanded"), "other_commanded")
    return other, built
